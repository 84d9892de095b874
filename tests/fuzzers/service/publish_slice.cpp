// PublishSlice: one more plane of a solid.
#include "service/rpc/palpation_messages.h"
#include "service/scene/errors.h"
#include "tests/fuzzers/service/fuzzers.h"
#include "tests/scene/stacks.h"

namespace teletact::fuzzers {
namespace {

using namespace service;

// 3 x 2 elements of 10 x 10 mm, and 4 of 5 mm along z, with one slice.
ExplicitModulus solid() {
  ExplicitModulus e{{0, 0.01, 0.02, 0.03}, {0, 0.01, 0.02}, {}, {-0.01, -0.005, 0, 0.005, 0.01}};
  return stacked(e, {{0, {}, {}, std::vector<double>(6, 1e4)}}, {});
}

void check(const GrownModulus& grown) {
  const ExplicitModulus& e = grown.modulus;
  require(grown.slice < e.slices_m.size() && e.slices_m.size() <= 2, "a slice that is not there");
  require(e.youngs_modulus_pa.size() == 6 * e.slices_m.size(), "a modulus that does not fill its slices");
  require(e.log_deviation.empty() || e.log_deviation.size() == e.youngs_modulus_pa.size(),
          "deviations that do not fill the slices");
  for (const double modulus_pa : e.youngs_modulus_pa)
    require(modulus_pa >= 1 && modulus_pa <= 1e12, "a modulus that cannot be");
  for (const double deviation : e.log_deviation)
    require(deviation >= 0 && deviation <= 10, "a deviation that cannot be");
  for (std::size_t n = 0; n < e.slices_m.size(); ++n)
    require(e.slices_m[n] >= e.z_m.front() && e.slices_m[n] <= e.z_m.back() &&
                (n == 0 || e.slices_m[n - 1] < e.slices_m[n]),
            "slices out of order, or beside the solid");
}

}  // namespace

bool publish_slice(Bytes bytes) {
  static const ExplicitModulus before = solid();
  v1::PublishSliceRequest request;
  if (!request.ParseFromArray(bytes.data(), static_cast<int>(bytes.size()))) return false;
  GrownModulus grown;
  if (!accepted<std::invalid_argument, Error>(
          [&] { grown = with_slice(before, slice_from("slice", request.slice(), before), {}); }))
    return false;
  check(grown);
  return true;
}

}  // namespace teletact::fuzzers
