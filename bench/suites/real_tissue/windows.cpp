#include "bench/suites/real_tissue/windows.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <set>

#include "bench/basics/clock.h"
#include "bench/basics/median.h"
#include "bench/suite.h"

namespace teletact::bench {
namespace {

constexpr double kFromFaceM = 0.003, kInside = 0.7, kBeside = 1.3;
constexpr std::size_t kMaxInMean = 400;  // nodes in the variance of a mean

service::Estimate estimate(service::Elastography& elastography, const Window& w, const Estimator& by) {
  service::TissueExtent extent = w.extent;
  by.state(extent);
  // A pad takes the force's place.
  const auto force = extent.pad ? std::nullopt : std::optional(w.force);
  return elastography.estimate(w.pre, w.post, {w.geometry, force, extent});
}

// Median of what the tracked axial displacement is off by, where it is trusted.
double tracking_error(const service::Estimate& e, const Window& w) {
  std::vector<double> off_m;
  for (std::size_t n = 0; n < e.grid.size(); ++n) {
    if (!e.displacement_valid[n]) continue;
    const double truth_m = w.axial_m(w.extent.window_x_m + e.grid.x_m(n), e.grid.y_m(n));
    off_m.push_back(std::abs(e.axial_displacement[n] - truth_m));
  }
  return median_of(off_m);
}

// A mean over nodes of errors that correlate by exp(-distance / length).
void mean_of(const service::Estimate& e, const std::vector<double>& error, std::vector<std::size_t> nodes,
             double& mean, double& deviation) {
  if (nodes.empty()) return;
  const std::size_t step = 1 + nodes.size() / kMaxInMean;
  std::vector<std::size_t> some;
  for (std::size_t n = 0; n < nodes.size(); n += step) some.push_back(nodes[n]);
  double sum = 0, variance = 0;
  for (const std::size_t a : some) {
    sum += error[a];
    for (const std::size_t b : some)
      variance += e.modulus.log_deviation[a] * e.modulus.log_deviation[b] *
                  std::exp(-std::hypot(e.grid.x_m(a) - e.grid.x_m(b), e.grid.y_m(a) - e.grid.y_m(b)) /
                           e.modulus.correlation_m);
  }
  mean = sum / static_cast<double>(some.size());
  deviation = std::sqrt(variance) / static_cast<double>(some.size());
}

RealWindow judge(const service::Estimate& e, const Window& w) {
  std::vector<double> error(e.grid.size(), kNan), beside, inside, above, below, deviations, offs;
  std::vector<std::size_t> beside_nodes, inside_nodes;
  double held = 0, judged = 0, skin_held = 0, skin = 0, deepest_m = 0;
  std::vector<std::pair<double, double>> by_depth;
  for (std::size_t n = 0; n < e.grid.size(); ++n) {
    const double x = w.extent.window_x_m + e.grid.x_m(n), y = e.grid.y_m(n),
                 modulus = e.modulus.youngs_modulus[n];
    if (!std::isfinite(modulus)) continue;
    error[n] = std::log(modulus / w.modulus_pa(x, y));
    const double stated = e.modulus.log_deviation[n];
    const bool holds = std::abs(error[n]) <= kQuantile * stated;
    if (y < kFromFaceM) {
      ++skin, skin_held += holds;
      continue;
    }
    offs.push_back(std::abs(error[n]));
    ++judged, held += holds;
    deviations.push_back(stated);
    double radii = std::numeric_limits<double>::infinity();
    for (const client::Inclusion& i : w.lumps)
      radii = std::min(radii, 2 * std::hypot(x - i.x_m, y - i.y_m) / i.diameter_m);
    if (radii > kBeside) {
      beside.push_back(std::exp(error[n]));
      beside_nodes.push_back(n);
      by_depth.emplace_back(y, std::exp(error[n]));
      deepest_m = std::max(deepest_m, y);
    } else if (radii < kInside) {
      inside.push_back(std::exp(error[n]));
      inside_nodes.push_back(n);
    }
  }
  const double third_m = (deepest_m - kFromFaceM) / 3;
  for (const auto& [y, ratio] : by_depth) {
    if (y < kFromFaceM + third_m) above.push_back(ratio);
    if (y > deepest_m - third_m) below.push_back(ratio);
  }
  RealWindow f;
  f.tracking_m = tracking_error(e, w);
  f.background = median_of(beside);
  if (!inside.empty()) f.contrast = median_of(inside) / f.background;
  f.ramp = median_of(below) / median_of(above);
  f.coverage = held / judged, f.skin_held = skin_held / skin;
  f.deviation = median_of(deviations);
  f.off = quantiles(offs).p95;
  mean_of(e, error, inside_nodes, f.lump_error, f.lump_deviation);
  mean_of(e, error, beside_nodes, f.background_error, f.background_deviation);
  return f;
}

}  // namespace

std::vector<Estimator> estimators() {
  return {{"solid", [](service::TissueExtent&) {}, true},
          {"solid, fitted", [](service::TissueExtent& e) { e.probe_elevation_m = 0, e.depth_stated = false; },
           false},
          {"plane strain",
           [](service::TissueExtent& e) {
             e.plane = service::Plane::kStrain, e.probe_elevation_m = 0, e.depth_stated = true;
             e.pad.reset();
           },
           false}};
}

RealWindow estimated(service::Elastography& elastography, const RealRow& row, std::uint64_t seed,
                     const Window& w, const Estimator& by) {
  RealWindow out;
  service::Estimate e;
  double seconds = 0;
  try {
    const double processor_s = processor_seconds_of(
        [&] { seconds = seconds_of([&] { e = estimate(elastography, w, by); }); }, CLOCK_PROCESS_CPUTIME_ID);
    out = judge(e, w);
    out.seconds = seconds, out.processor_s = processor_s, out.modulus_s = e.modulus_s;
    std::set<std::string> said;
    for (const service::Warning& warning : e.modulus.warnings) said.insert(service::name_of(warning.flag));
    out.said.assign(said.begin(), said.end());
  } catch (const std::exception& error) {
    out.refused = true;
    fmt::print("{}, contrast {}, seed {}, {}: {}\n", row.name, row.contrast, seed, by.name, error.what());
  }
  out.row = row.name, out.estimator = by.name, out.contrast_of_lump = row.contrast, out.seed = seed;
  out.truth_s = w.truth_s;
  return out;
}

}  // namespace teletact::bench
