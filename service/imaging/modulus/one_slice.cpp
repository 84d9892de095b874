#include "service/imaging/modulus/one_slice.h"

#include <algorithm>
#include <cmath>
#include <iterator>
#include <numbers>
#include <vector>

#include "service/device/cancellation.h"
#include "service/imaging/modulus/cell_strains.h"

namespace teletact::service {
namespace {

using Eigen::Index;
using Eigen::VectorXd;

// Over how far along the image a plane at z takes the median, to each side, in z. A lump that is 2 a long is
// lost where that exceeds 2 a; a disc of radius a reaches pi / 4 a across in the mean.
constexpr double kAlong = 8 / std::numbers::pi;
// Of ln E in two slices, one over the other: from kAlike on they show one lump, up to kShadow what one shows
// is the other's shadow: 5 mm beside a ball of 10 mm a slice alone reads 0.23 of its ln E.
constexpr double kAlike = 0.45, kShadow = 0.3;
// Difference of ln E: up to the less it is by how each was read alone (above and below a cylinder that is
// read as a ball 0.39), from the more on it is the tissue's.
constexpr double kMisreadLog = 0.4, kDiffersLog = 0.7;
constexpr double kNextPlane = 1.25;  // of the offset of the plane before

VectorXd median_along(const VectorXd& field, const CellGrid& cells, Index reach) {
  const auto columns = static_cast<Index>(cells.columns);
  VectorXd out(field.size());
  std::vector<double> window;  // in order
  for (Index first = 0; first < field.size(); first += columns) {
    const auto at = [&](Index k) {  // mirrored at the image's ends
      const Index mirrored = k < 0 ? -1 - k : k < columns ? k : 2 * columns - 1 - k;
      return field[first + std::clamp<Index>(mirrored, 0, columns - 1)];
    };
    window.clear();
    for (Index k = -reach; k <= reach; ++k) window.push_back(at(k));
    std::ranges::sort(window);
    for (Index i = 0; i < columns; ++i) {
      out[first + i] = window[window.size() / 2];
      window.erase(std::ranges::lower_bound(window, at(i - reach)));
      const double next = at(i + 1 + reach);
      window.insert(std::ranges::upper_bound(window, next), next);
    }
  }
  return out;
}

}  // namespace

ProbedTissue::Planes planes_told(const std::vector<SliceBeside>& beside, const ProbedTissue& tissue,
                                 double top_m, double range_log) {
  const CellGrid& cells = tissue.cells();
  ProbedTissue::Planes planes;
  for (const SliceBeside& slice : beside) {
    if (std::abs(slice.offset_m) < tissue.nearest_plane_m()) continue;
    check_cancelled();
    VectorXd logarithm = VectorXd::Zero(static_cast<Index>(cells.size())), observed = logarithm;
    for (std::size_t c = 0; c < cells.size(); ++c) {
      const double modulus_pa = slice.modulus_pa(cells.x_m(c), cells.y_m(c) + top_m);
      if (!(modulus_pa > 0 && std::isfinite(modulus_pa))) continue;
      logarithm[static_cast<Index>(c)] = std::log(modulus_pa), observed[static_cast<Index>(c)] = 1;
    }
    if (!(observed.maxCoeff() > 0)) continue;
    logarithm = ((logarithm.array() - level_of(logarithm, observed)) * observed.array()).matrix();
    planes.push_back({slice.offset_m, logarithm.cwiseMax(-range_log).cwiseMin(range_log)});
  }
  return planes;
}

ProbedTissue::Planes with_shared_lumps(ProbedTissue::Planes beside, const VectorXd& log_modulus) {
  const auto from = [](double at, double none, double all) {
    return std::clamp((at - none) / (all - none), 0.0, 1.0);
  };
  for (ProbedTissue::ImagePlane& plane : beside)
    for (Index c = 0; c < log_modulus.size(); ++c) {
      const double own = log_modulus[c];
      double& other = plane.log_modulus[c];
      if (own * other > 0 && std::abs(other) < std::abs(own))
        other = from(other / own, kShadow, kAlike) * own;
      else if (other != 0)
        other += std::max(from(own / other, kShadow, kAlike),
                          from(std::abs(own - other), kDiffersLog, kMisreadLog)) *
                 (own - other);
    }
  return beside;
}

namespace {

// Between this slice and the next, which is as with_shared_lumps() has it: what that does not show of this
// one's ends as a ball.
void add_between(ProbedTissue::Planes& out, const ProbedTissue::ImagePlane& next, const VectorXd& own,
                 const ProbedTissue& tissue) {
  const double apart_m = std::abs(next.offset_m);
  const auto less = (next.log_modulus.array().abs() < own.array().abs()).eval();
  const VectorXd ends = less.select(own - next.log_modulus, 0.0), goes_on = own - ends;
  for (double z_m = tissue.nearest_plane_m(); z_m < apart_m; z_m *= kNextPlane) {
    check_cancelled();
    const double way_back = 1 - z_m / apart_m;
    const VectorXd to_next = next.log_modulus + way_back * way_back * (goes_on - next.log_modulus);
    const auto reach = static_cast<Index>(std::lround(kAlong * z_m / tissue.cells().spacing_m));
    out.push_back({std::copysign(z_m, next.offset_m), to_next + median_along(ends, tissue.cells(), reach)});
  }
}

}  // namespace

ProbedTissue::Planes planes_between(ProbedTissue::Planes beside, const VectorXd& log_modulus,
                                    const ProbedTissue& tissue) {
  const auto after = std::ranges::find_if(beside, [](const auto& plane) { return plane.offset_m > 0; });
  ProbedTissue::Planes between;
  if (after != beside.end()) add_between(between, *after, log_modulus, tissue);
  if (after != beside.begin()) add_between(between, *std::prev(after), log_modulus, tissue);
  beside.insert(beside.end(), between.begin(), between.end());
  std::ranges::sort(beside, {}, &ProbedTissue::ImagePlane::offset_m);
  return beside;
}

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
