#include "service/scene/slices.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <numeric>
#include <stdexcept>
#include <utility>

#include "service/scene/errors.h"

namespace teletact::service {
namespace {

void check_nodes(const std::string& field, const std::vector<double>& given_m,
                 const std::vector<double>& own_m) {
  const double slack_m = 1e-6 * (own_m.back() - own_m.front()) / static_cast<double>(own_m.size() - 1);
  const auto same = [slack_m](double a, double b) { return std::abs(a - b) <= slack_m; };
  if (!given_m.empty() && !std::equal(given_m.begin(), given_m.end(), own_m.begin(), own_m.end(), same))
    throw std::invalid_argument(fmt::format(
        "{}: not the solid's own {} nodes from {} to {} m; resample the slice onto them, or leave it out",
        field, own_m.size(), own_m.front(), own_m.back()));
}

void check(const std::string& field, const ModulusSlice& slice, const ExplicitModulus& grid) {
  if (!(slice.z_m >= grid.z_m.front() && slice.z_m <= grid.z_m.back()))
    throw std::invalid_argument(
        fmt::format("{}.pose.origin_m[2]: {} m is beside the solid, which reaches "
                    "from {} to {} m",
                    field, slice.z_m, grid.z_m.front(), grid.z_m.back()));
  check_nodes(field + ".modulus.x_m", slice.x_m, grid.x_m);
  check_nodes(field + ".modulus.y_m", slice.y_m, grid.y_m);
  const std::size_t elements = (grid.x_m.size() - 1) * (grid.y_m.size() - 1);
  if (slice.youngs_modulus_pa.size() != elements)
    throw std::invalid_argument(fmt::format("{}.modulus.youngs_modulus_pa: {} values for {} elements", field,
                                            slice.youngs_modulus_pa.size(), elements));
  check_moduli(field + ".modulus.youngs_modulus_pa", slice.youngs_modulus_pa);
}

void require_room(const ExplicitModulus& grid, std::size_t slices, const Limits& limits) {
  const std::size_t plane = (grid.x_m.size() - 1) * (grid.y_m.size() - 1);
  if (slices > limits.most_solid_elements / plane)
    throw Error(ErrorKind::kExhausted,
                fmt::format("slices: {} of {} elements, at most {} in all are allowed; use a coarser grid or "
                            "fewer slices",
                            slices, plane, limits.most_solid_elements));
}

}  // namespace

void check_moduli(const std::string& field, const std::vector<double>& youngs_modulus_pa) {
  constexpr double kSoftest = 1, kHardest = 1e12;
  for (std::size_t n = 0; n < youngs_modulus_pa.size(); ++n)
    if (const double e = youngs_modulus_pa[n]; !(e >= kSoftest && e <= kHardest))
      throw std::invalid_argument(fmt::format("{}[{}]: {} Pa; a modulus must be within [{}, {}] Pa", field, n,
                                              e, kSoftest, kHardest));
}

ExplicitModulus stacked(ExplicitModulus grid, const std::vector<ModulusSlice>& slices, const Limits& limits) {
  if (slices.empty()) throw std::invalid_argument("slices: none; give at least one");
  require_room(grid, slices.size(), limits);
  const auto name = [](std::size_t n) { return fmt::format("slices[{}]", n); };
  for (std::size_t n = 0; n < slices.size(); ++n) check(name(n), slices[n], grid);
  std::vector<std::size_t> by_z(slices.size());
  std::iota(by_z.begin(), by_z.end(), 0);
  std::sort(by_z.begin(), by_z.end(),
            [&](std::size_t a, std::size_t b) { return slices[a].z_m < slices[b].z_m; });
  for (const std::size_t n : by_z) {
    const ModulusSlice& slice = slices[n];
    if (!grid.slices_m.empty() && slice.z_m - grid.slices_m.back() < kSameSliceM)
      throw std::invalid_argument(
          fmt::format("{}.pose.origin_m[2]: {} m has another slice already; give one for each place", name(n),
                      slice.z_m));
    grid.slices_m.push_back(slice.z_m);
    grid.youngs_modulus_pa.insert(grid.youngs_modulus_pa.end(), slice.youngs_modulus_pa.begin(),
                                  slice.youngs_modulus_pa.end());
  }
  return grid;
}

GrownModulus with_slice(const ExplicitModulus& old, const ModulusSlice& slice, const Limits& limits) {
  check("slice", slice, old);
  GrownModulus out{old, 0};
  std::vector<double>& places = out.modulus.slices_m;
  if (places.empty())
    for (std::size_t n = 0; n < old.slices(); ++n) places.push_back(old.slice_m(n));
  const auto at = std::lower_bound(places.begin(), places.end(), slice.z_m - kSameSliceM);
  out.slice = static_cast<std::size_t>(at - places.begin());
  std::vector<double>& all = out.modulus.youngs_modulus_pa;
  const auto to = all.begin() + static_cast<std::ptrdiff_t>(out.slice * slice.youngs_modulus_pa.size());
  if (at != places.end() && *at - slice.z_m < kSameSliceM) {
    std::copy(slice.youngs_modulus_pa.begin(), slice.youngs_modulus_pa.end(), to);
    return out;
  }
  require_room(old, places.size() + 1, limits);
  places.insert(at, slice.z_m);
  all.insert(to, slice.youngs_modulus_pa.begin(), slice.youngs_modulus_pa.end());
  return out;
}

double from_slices_m(const ExplicitModulus& e, double z_m) {
  if (e.slices_m.empty()) return 0;
  double nearest_m = HUGE_VAL;
  for (const double slice_m : e.slices_m) nearest_m = std::min(nearest_m, std::abs(slice_m - z_m));
  const double spacing_m = (e.z_m.back() - e.z_m.front()) / static_cast<double>(e.z_m.size() - 1);
  return nearest_m <= spacing_m / 2 ? 0 : nearest_m;
}

}  // namespace teletact::service
