#include "service/imaging/modulus/one_slice.h"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <vector>

#include "service/device/cancellation.h"
#include "service/imaging/tracking/median.h"

namespace teletact::service {
namespace {

using Eigen::Index;
using Eigen::VectorXd;

// Over how far along the image a plane at z takes the median, to each side, in z. A lump that is 2 a long is
// lost where that exceeds 2 a; a disc of radius a reaches pi / 4 a across in the mean.
constexpr double kAlong = 8 / std::numbers::pi;
constexpr double kNextPlane = 1.25;  // of the offset of the plane before

VectorXd median_along(const VectorXd& field, const CellGrid& cells, Index reach) {
  const auto columns = static_cast<Index>(cells.columns);
  VectorXd out(field.size());
  std::vector<double> values;
  for (Index first = 0; first < field.size(); first += columns)
    for (Index i = 0; i < columns; ++i) {
      values.clear();
      for (Index k = i - reach; k <= i + reach; ++k) {  // mirrored at the image's ends
        const Index mirrored = k < 0 ? -1 - k : k < columns ? k : 2 * columns - 1 - k;
        values.push_back(field[first + std::clamp<Index>(mirrored, 0, columns - 1)]);
      }
      out[first + i] = median(values);
    }
  return out;
}

}  // namespace

ProbedTissue::Planes planes_beyond(ProbedTissue::Planes beside, const VectorXd& log_modulus,
                                   const ProbedTissue& tissue) {
  const CellGrid& cells = tissue.cells();
  const ProbedTissue::ImagePlane own{0, log_modulus};
  const ProbedTissue::ImagePlane before =
                                     beside.empty() || beside.front().offset_m > 0 ? own : beside.front(),
                                 after = beside.empty() || beside.back().offset_m < 0 ? own : beside.back();
  const double length_m = static_cast<double>(cells.columns) * cells.spacing_m;
  // Beyond the last the median is of the whole image.
  for (double z_m = tissue.nearest_plane_m(); z_m < kNextPlane * length_m / (2 * kAlong); z_m *= kNextPlane) {
    check_cancelled();
    const auto reach = static_cast<Index>(std::lround(kAlong * z_m / cells.spacing_m));
    const VectorXd last = median_along(after.log_modulus, cells, reach);
    const bool alone = before.offset_m == after.offset_m;
    beside.insert(beside.begin(),
                  {before.offset_m - z_m, alone ? last : median_along(before.log_modulus, cells, reach)});
    beside.push_back({after.offset_m + z_m, last});
  }
  return beside;
}

}  // namespace teletact::service
