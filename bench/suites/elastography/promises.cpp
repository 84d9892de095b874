// What the chart holds the product to. A figure that this run has no method or no case for is left out.
#include <algorithm>
#include <cmath>
#include <limits>

#include "bench/suites/elastography/elastography.h"

namespace teletact::bench {
namespace {

// The product's estimator.
template <class Methods>
const auto& ours_of(const Methods& methods) {
  return methods.front();
}

void add_rigid(const RigidFigures& rigid, Promises& promises) {
  const std::vector<RigidPhase>& phases = ours_of(rigid.methods).phases;
  double squares = 0, bias_m = 0;
  for (const RigidPhase& phase : phases) {
    squares += std::pow(phase.rmse_m, 2);
    bias_m = std::max(bias_m, std::abs(phase.bias_m));
  }
  const double rmse_m = std::sqrt(squares / static_cast<double>(phases.size()));
  const double bound_m = rigid.bound_m / std::sqrt(rigid.independent_lines);
  promises.push_back({"regularised_rigid_shift_rmse_over_the_bound_of_one_window", rmse_m / bound_m, 1.0});
  promises.push_back({"rigid_shift_largest_bias", 1e6 * bias_m, 0.1, "um"});
}

// The phantoms of T2.7 are compressed by up to 5 %; the strain's curve goes on beyond.
bool promised(const Condition& c) {
  constexpr double kMaxStrain = 0.05;
  return c.of.strain <= kMaxStrain;
}

void add_calibration(const ElastographyFigures& figures, Promises& promises) {
  double least = std::numeric_limits<double>::infinity(), most = 0;
  for (const Condition& c : figures.conditions)
    for (const Spread* where : {&c.calibration.inside, &c.calibration.outside}) {
      if (!promised(c)) continue;
      const double z = where->rms;
      least = z >= least || std::isnan(least) ? least : z;  // one without a figure is a loss, too
      most = z <= most || std::isnan(most) ? most : z;
    }
  promises.push_back({"standardised_errors_least_deviation_of_all_conditions", least, 0.8, "", false});
  promises.push_back({"standardised_errors_most_deviation_of_all_conditions", most, 1.2});
}

// How ours stands to one peer at one condition, paired by seed.
struct Comparison {
  bool above = false, below = false;  // below: beyond the 95 % interval of the difference
};

// A method without a figure at a seed loses it: against a peer that has one by all of the peer's figure. When
// that is so at half of the seeds, ours is below whatever the interval, which is wide then.
Comparison compare(const TrackerFigures& ours, const TrackerFigures& peer) {
  const auto a = ours.at_edge(&StrainQuality::snre), b = peer.at_edge(&StrainQuality::snre);
  std::vector<double> differences;
  double lost = 0;
  for (std::size_t k = 0; k < std::min(a.size(), b.size()); ++k) {
    lost += std::isnan(a[k]) && std::isfinite(b[k]);
    differences.push_back((std::isfinite(a[k]) ? a[k] : 0) - (std::isfinite(b[k]) ? b[k] : 0));
  }
  const Interval d = interval95(differences);
  const bool loses = 2 * lost >= static_cast<double>(differences.size());
  return {d.mean > 0 && !loses, loses || d.mean + d.half_width < 0};
}

bool is_filter_point(const Condition& c) {
  return promised(c) && (c.on("strain") || c.on("snr") || c.on("correlation"));
}

// SNRe against strain, 0 where the image is lost; on beyond what is promised until it falls.
void add_band_pass(const ElastographyFigures& figures, Promises& promises) {
  std::vector<std::pair<double, double>> curve;
  for (const Condition& c : figures.conditions) {
    if (!c.on("strain")) continue;
    auto snre = ours_of(c.methods).at_edge(&StrainQuality::snre);
    for (double& s : snre) s = std::isfinite(s) ? s : 0;
    curve.emplace_back(c.of.strain, interval95(snre).mean);
  }
  std::sort(curve.begin(), curve.end());
  double peak = kNan;
  for (const auto& [strain, snre] : curve) peak = std::fmax(peak, snre);
  promises.push_back({"snre_at_the_least_strain_over_its_peak", curve.front().second / peak, 0.5});
  promises.push_back({"snre_at_the_largest_strain_over_its_peak", curve.back().second / peak, 0.999});
}

void add_strain_filter(const ElastographyFigures& figures, Promises& promises) {
  double points = 0, above = 0, below = 0;
  for (const Condition& c : figures.conditions) {
    if (!is_filter_point(c)) continue;
    bool above_all = true;
    for (const TrackerFigures& m : c.methods) {
      if (m.ours) continue;
      const Comparison with = compare(ours_of(c.methods), m);
      above_all &= with.above;
      below += with.below;
    }
    ++points;
    above += above_all;
  }
  promises.push_back(
      {"points_where_snre_at_the_same_edge_width_is_above_every_peer", above / points, 0.8, "", false});
  promises.push_back({"points_where_a_peer_is_above_beyond_the_95_percent_interval", below, 0});
  add_band_pass(figures, promises);
}

// Who has no valid node has lost; ours also where neither has one.
double error_ratio(double ours, double peer) {
  if (std::isnan(ours)) return std::numeric_limits<double>::infinity();
  return std::isnan(peer) ? 0 : ours / peer;
}

// Medians of ratios, seed by seed, over the conditions of the filter.
void add_speed(const ElastographyFigures& figures, Promises& promises) {
  const std::vector<TrackerFigures>& methods = figures.middle().methods;
  for (std::size_t m = 0; m < methods.size(); ++m) {
    if (methods[m].ours) continue;
    std::vector<double> time, processor, error;
    for (const Condition& c : figures.conditions) {
      if (!is_filter_point(c)) continue;
      for (std::size_t k = 0; k < c.methods[m].seeds.size(); ++k) {
        const SeedFigures &ours = ours_of(c.methods).seeds[k], &peer = c.methods[m].seeds[k];
        time.push_back(ours.seconds / peer.seconds);
        processor.push_back(ours.processor_s / peer.processor_s);
        error.push_back(error_ratio(ours.errors.axial_rmse_m, peer.errors.axial_rmse_m));
      }
    }
    const std::string over = "_over_" + snake_case(methods[m].method);
    promises.push_back({"displacement_time" + over, median_of(time), 1});
    promises.push_back({"displacement_processor_time" + over, median_of(processor), 1});
    promises.push_back({"displacement_axial_rmse" + over, median_of(error), 1});
  }
}

void add_plane(const StageFigures& stages, Promises& promises) {
  promises.push_back(
      {"imaging_with_direct_modulus_beside_a_touch_stream_p50", 1e3 * stages.direct.total_s.p50, 150, "ms"});
  promises.push_back({"imaging_with_iterative_modulus_beside_a_touch_stream_p50",
                      1e3 * stages.iterative.total_s.p50, 450, "ms"});
}

// Where a method does not work any more, in the order of the questions.
std::string failure(const TrackerFigures& m) {
  const double valid = median_of(m.over_seeds([](const auto&s) { return s.errors.valid_fraction; })),
               hops = median_of(m.over_seeds([](const auto&s) { return s.errors.hop_fraction; }));
  if (!(hops <= 0.01)) return "hops to a wrong peak";
  if (!(valid >= 0.9)) return "loses correlation";
  std::vector<double> snre = m.at_edge(&StrainQuality::snre);
  std::erase_if(snre, [](double s) { return !std::isfinite(s); });
  if (snre.empty()) return "is not as sharp as the edge width compared at";
  if (!(median_of(snre) >= 3)) return "SNRe below 3";
  return {};
}

}  // namespace

std::vector<double> TrackerFigures::at_edge(double StrainQuality::*figure) const {
  std::vector<double> values;
  for (const SeedFigures& seed : seeds) {
    values.push_back(kNan);
    for (std::size_t k = 0; k + 1 < edges.size(); ++k) {
      const double a = edges[k].axial_m, b = edges[k + 1].axial_m;
      if (!(a <= kEdgeM && kEdgeM < b)) continue;
      const double t = (kEdgeM - a) / (b - a);
      values.back() =
          std::exp((1 - t) * std::log(seed.strain[k].*figure) + t * std::log(seed.strain[k + 1].*figure));
      break;
    }
  }
  return values;
}

std::vector<Failure> failures(const std::vector<Condition>& conditions) {
  std::vector<Failure> out;
  for (const Condition& c : conditions)
    for (const TrackerFigures& m : c.methods)
      if (const std::string why = failure(m); !why.empty()) out.push_back({m.method, c.of, why});
  return out;
}

std::vector<WithoutFigure> without_figure(const std::vector<Condition>& conditions) {
  std::vector<WithoutFigure> out;
  for (const Condition& c : conditions)
    for (const TrackerFigures& m : c.methods) {
      const auto snre = m.at_edge(&StrainQuality::snre);
      const auto none = std::count_if(snre.begin(), snre.end(), [](double s) { return std::isnan(s); });
      if (none > 0) out.push_back({m.method, c.of, static_cast<std::size_t>(none), snre.size()});
    }
  return out;
}

void add_elastography_promises(const ElastographyFigures& figures, Promises& promises) {
  add_rigid(figures.rigid, promises);
  add_calibration(figures, promises);
  add_strain_filter(figures, promises);
  add_modulus_promises(figures.modulus, promises);
  add_speed(figures, promises);
  add_plane(figures.stages, promises);
}

}  // namespace teletact::bench
