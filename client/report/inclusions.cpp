#include "client/report/inclusions.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>
#include <stdexcept>
#include <utility>

#include "client/report/nearest_matches.h"

namespace teletact::client {
namespace {

constexpr double kSmoothM = 0.002;  // width of the median filter before the threshold
constexpr double kThreshold = 1.5;  // times the background's median
constexpr double kMinAreaM2 = 15e-6;
constexpr double kMatchM = 0.005;     // found and true centres this close are the same
constexpr double kInnerRadius = 0.7;  // (T3.3): contrast is taken well inside

bool known(float pa) {
  return std::isfinite(pa) && pa > 0;
}

float median(std::vector<float>& values) {
  const auto middle = values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2);
  std::nth_element(values.begin(), middle, values.end());
  return *middle;
}

// Median over a square of `width_m`; unknown where most of the square is.
std::vector<float> smoothed(const ModulusGrid& map, double width_m) {
  const auto rx = static_cast<std::ptrdiff_t>(width_m / 2 / map.dx_m);
  const auto ry = static_cast<std::ptrdiff_t>(width_m / 2 / map.dy_m);
  const auto nx = static_cast<std::ptrdiff_t>(map.nx), ny = static_cast<std::ptrdiff_t>(map.ny);
  std::vector<float> out(map.pa.size(), std::numeric_limits<float>::quiet_NaN()), square;
  for (std::ptrdiff_t j = 0; j < ny; ++j)
    for (std::ptrdiff_t i = 0; i < nx; ++i) {
      square.clear();
      std::size_t inside = 0;
      for (auto b = std::max<std::ptrdiff_t>(0, j - ry); b <= std::min(ny - 1, j + ry); ++b)
        for (auto a = std::max<std::ptrdiff_t>(0, i - rx); a <= std::min(nx - 1, i + rx); ++a, ++inside)
          if (known(map.pa[a + nx * b])) square.push_back(map.pa[a + nx * b]);
      if (2 * square.size() > inside) out[i + nx * j] = median(square);
    }
  return out;
}

// The nodes of the 4-connected component that holds `seed`; they are taken out of `above`.
std::vector<std::size_t> take_component(const ModulusGrid& map, std::size_t seed, std::vector<char>& above) {
  std::vector<std::size_t> nodes{seed};
  above[seed] = 0;
  for (std::size_t k = 0; k < nodes.size(); ++k) {
    const std::size_t i = nodes[k] % map.nx, j = nodes[k] / map.nx;
    const auto visit = [&](bool inside, std::size_t node) {
      if (inside && above[node]) above[node] = 0, nodes.push_back(node);
    };
    visit(i > 0, nodes[k] - 1);
    visit(i + 1 < map.nx, nodes[k] + 1);
    visit(j > 0, nodes[k] - map.nx);
    visit(j + 1 < map.ny, nodes[k] + map.nx);
  }
  return nodes;
}

FoundInclusion measure(const ModulusGrid& map, const std::vector<std::size_t>& nodes, double background_pa) {
  FoundInclusion found;
  for (const std::size_t node : nodes) {
    found.x_m += map.x(node % map.nx) / static_cast<double>(nodes.size());
    found.y_m += map.y(node / map.nx) / static_cast<double>(nodes.size());
  }
  const double area = static_cast<double>(nodes.size()) * map.dx_m * map.dy_m;
  found.diameter_m = 2 * std::sqrt(area / std::numbers::pi);
  std::vector<float> inner;
  for (const std::size_t node : nodes) {
    const double distance = std::hypot(map.x(node % map.nx) - found.x_m, map.y(node / map.nx) - found.y_m);
    if (distance <= kInnerRadius * found.diameter_m / 2 && known(map.pa[node])) inner.push_back(map.pa[node]);
  }
  if (!inner.empty()) found.contrast = median(inner) / background_pa;
  return found;
}

}  // namespace

InclusionReport find_inclusions(const ModulusGrid& map, const std::vector<Inclusion>& truth) {
  if (map.pa.size() != map.nx * map.ny || !(map.dx_m > 0) || !(map.dy_m > 0))
    throw std::invalid_argument("the modulus map does not fill its grid");
  InclusionReport report;
  std::vector<float> values;
  std::copy_if(map.pa.begin(), map.pa.end(), std::back_inserter(values), known);
  if (values.empty()) throw std::invalid_argument("nothing of the modulus map is known");
  report.background_pa = median(values);
  const std::vector<float> smooth = smoothed(map, kSmoothM);
  std::vector<char> above(smooth.size());
  for (std::size_t k = 0; k < smooth.size(); ++k) above[k] = smooth[k] > kThreshold * report.background_pa;
  for (std::size_t k = 0; k < above.size(); ++k) {
    if (!above[k]) continue;
    const std::vector<std::size_t> nodes = take_component(map, k, above);
    if (static_cast<double>(nodes.size()) * map.dx_m * map.dy_m >= kMinAreaM2)
      report.found.push_back(measure(map, nodes, report.background_pa));
  }
  NearestMatches matches =
      nearest_matches(truth.size(), report.found.size(), kMatchM, [&](std::size_t t, std::size_t f) {
        return std::hypot(truth[t].x_m - report.found[f].x_m, truth[t].y_m - report.found[f].y_m);
      });
  report.match = std::move(matches.of_truth), report.spurious = std::move(matches.unmatched);
  return report;
}

}  // namespace teletact::client
