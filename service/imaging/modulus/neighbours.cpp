#include "service/imaging/modulus/neighbours.h"

#include <algorithm>
#include <array>
#include <cmath>

#include "service/device/cancellation.h"
#include "service/imaging/tracking/median.h"

namespace teletact::service {
namespace {

constexpr double kBorderM = 4e-3;       // on each side of a border
constexpr std::size_t kMinShared = 50;  // nodes that a comparison needs
// Over a region the posterior's errors average out: of a median's deviation over that of its nodes.
constexpr double kOfMedian = 0.5;

// log E against what was known at the same place, and what both claim of it together.
struct Comparison {
  struct Place {
    float difference, deviation;
  };
  std::vector<Place> places;
  double common = 0;  // deviation of log E that places share
  void add(float modulus, float deviation_here, const KnownModulus& known, double x_m, double y_m) {
    const double stated = known(x_m, y_m);
    if (!std::isfinite(modulus) || !(stated > 0 && std::isfinite(stated))) return;
    // Without what the places of a window have in common, by the same sensor, area and tissue.
    const double all = known.log_deviation ? known.log_deviation(x_m, y_m) : NAN,
                 claimed = std::sqrt(std::max(all * all - common * common, all * all / 4));
    places.push_back(
        {static_cast<float>(std::log(modulus / stated)),
         static_cast<float>(std::hypot(deviation_here, std::isfinite(claimed) ? claimed : deviation_here))});
  }
  // Medians over the better known half: an inclusion on one side of a border, or cut by it, says nothing.
  Place typical() {
    const auto better = places.begin() + static_cast<std::ptrdiff_t>(places.size() / 2);
    std::nth_element(places.begin(), better, places.end(),
                     [](const Place& a, const Place& b) { return a.deviation < b.deviation; });
    std::vector<float> differences, deviations;
    for (auto p = places.begin(); p != better; ++p)
      differences.push_back(p->difference), deviations.push_back(p->deviation);
    return {static_cast<float>(median(differences)), static_cast<float>(median(deviations))};
  }
};

// Where other windows, or this one before, have been: under this window; and across each of its borders,
// where the tissue goes on: the places mirrored at the border.
std::array<Comparison, 3> compare(const ModulusInput& in, const ModulusEstimate& e) {
  std::array<Comparison, 3> out;
  for (Comparison& c : out) c.common = e.common_deviation;
  for (std::size_t n = 0; n < in.measured.grid.size(); ++n) {
    if (n % in.measured.grid.nx == 0) check_cancelled();
    const double x = in.measured.grid.x_m(n);
    const double y = in.measured.grid.y_m(n);
    const double left = in.tissue.window_x_m, right = left + in.window_width_m;
    const auto add = [&](Comparison& to, double at_m) {
      to.add(e.youngs_modulus[n], e.log_deviation[n], in.known, at_m, y);
    };
    add(out[0], left + x);
    if (x < kBorderM) add(out[1], left - x);
    if (in.window_width_m - x < kBorderM) add(out[2], right + in.window_width_m - x);
  }
  return out;
}

}  // namespace

Disagreement worst_disagreement(const ModulusInput& in, const ModulusEstimate& e) {
  Disagreement worst;
  for (Comparison& c : compare(in, e)) {
    if (c.places.size() < kMinShared) continue;
    const Comparison::Place typical = c.typical();
    const double of_median = e.kind == ModulusKind::kIterative ? kOfMedian : 1;
    const double off = std::abs(typical.difference) /
                       std::hypot(of_median * typical.deviation, std::sqrt(2.0) * in.force->own_deviation);
    if (off > worst.deviations) worst = {off, typical.difference};
  }
  return worst;
}

}  // namespace teletact::service
