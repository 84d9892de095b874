#include "service/imaging/modulus/stated_depth.h"

#include <algorithm>
#include <cmath>
#include <optional>

#include "service/base/squared.h"
#include "service/imaging/modulus/weighed_tissues.h"

namespace teletact::service {
namespace {

constexpr double kLastPart = 0.25;      // of the stated depth: what strain below is compared with
constexpr double kStrained = 0.15;      // of that: tissue, not a support
constexpr double kBandM = 2e-3;         // of what is asked whether it is strained
constexpr double kCertain = 2;          // standard deviations
constexpr double kLeastMeasured = 0.5;  // of a band's nodes that must be measured

struct RowsStrain {
  double strain, deviation;  // the mean, and what noise makes of it
};

// Of the rows from `from_m` to `to_m`; empty where too little of them is measured.
std::optional<RowsStrain> strain_between(const Measured& m, double from_m, double to_m) {
  double all = 0, measured = 0, sum = 0, squares = 0;
  for (std::size_t n = 0; n < m.grid.size(); ++n) {
    if (m.grid.y_m(n) < from_m || m.grid.y_m(n) >= to_m) continue;
    ++all;
    if (!m.strain_valid[n]) continue;
    ++measured, sum += m.axial_strain[n], squares += squared(m.axial_strain_noise[n]);
  }
  if (!(measured > 0 && measured >= kLeastMeasured * all)) return {};
  const double places = std::max(1.0, measured * m.grid.dx_m * m.grid.dy_m / kAlikeM2);
  return RowsStrain{sum / measured, std::sqrt(squares / measured / places)};
}

}  // namespace

double strained_below(const TissueExtent& tissue, const Measured& m, double kernel_m) {
  const double depth_m = tissue.depth_m,
               deviation = tissue.depth_std_m > 0 ? tissue.depth_std_m / depth_m : kLogStated,
               end_m = m.grid.y_m(m.grid.size() - 1) + m.grid.dy_m / 2;
  const auto above = strain_between(m, (1 - kLastPart) * depth_m, depth_m - kernel_m / 2);
  if (!above || above->strain == 0) return 0;
  double strained_m = 0;
  for (double from_m = depth_m * std::exp(KnownLength::kContradicted * deviation) + kernel_m / 2;
       from_m + kBandM <= end_m; from_m += kBandM) {
    const auto band = strain_between(m, from_m, from_m + kBandM);
    if (!band) break;
    const double noise = std::hypot(band->deviation, kStrained * above->deviation) / std::abs(above->strain);
    if (band->strain / above->strain < kStrained + kCertain * noise) break;
    strained_m = end_m - from_m < 2 * kBandM ? end_m : from_m + kBandM;
  }
  return strained_m;
}

TissueExtent believed(TissueExtent tissue, const Measured& m, double kernel_m) {
  if (!tissue.depth_stated || tissue.plane != Plane::kSolid) return tissue;
  if (const double strained_m = strained_below(tissue, m, kernel_m); strained_m > 0)
    tissue.doubted_depth_m = tissue.depth_m, tissue.depth_m = strained_m, tissue.depth_stated = false;
  return tissue;
}

}  // namespace teletact::service
