// One factor at a time from the middle (T2.7): 1 % compression, 30 dB, rho .99, contrast 3, 10 mm.
#include <fmt/format.h>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <ctime>

#include "bench/peers/rf_nodes.h"
#include "bench/phantoms/bounds.h"
#include "bench/phantoms/metrics.h"
#include "bench/suites/elastography/elastography.h"

namespace teletact::bench {
namespace {

using nlohmann::json;

const std::vector<double> kKernelsM{1.2e-3, 2.0e-3, 2.8e-3, 3.6e-3, 4.4e-3, 5.2e-3};
constexpr std::uint64_t kSeeds = 6, kQuickSeeds = 2;
// Of the default's standardised errors: inside an inclusion there are few independent ones in an image, so
// that their deviation differs by .1 to .3 from seed to seed.
constexpr std::uint64_t kCalibrationSeeds = 24;

client::Ultrasound ultrasound_of(const PhantomCase& c) {
  client::Ultrasound u;
  u.snr_db = c.snr_db;
  u.correlation = c.correlation;
  return u;
}

// The others are told to look as far as ours already from the default itself on.
bool searches_wide(const PhantomCase& c, bool ours) {
  const double usual = TrackerOptions{}.max_strain;
  return ours ? c.strain > usual : c.strain >= usual;
}

json describe(const PhantomCase& c) {
  return {{"strain", c.strain},
          {"snr_db", c.snr_db},
          {"correlation", c.correlation},
          {"max_strain", searches_wide(c, true) ? kWideStrain : TrackerOptions{}.max_strain},
          {"peers_max_strain", searches_wide(c, false) ? kWideStrain : TrackerOptions{}.max_strain},
          {"contrast", c.contrast},
          {"diameter_m", c.diameter_m}};
}

// Of one kernel with the windows of all methods, and the strain that it allows with the kernel that a plain
// window needs for the edge width of the comparison.
void add_bounds(const PhantomCase& c, const service::AcquisitionGeometry& g, json& out) {
  const client::Ultrasound u = ultrasound_of(c);
  const TrackerOptions o;
  const int lines = 1 + 2 * static_cast<int>(std::lround(o.window_lateral_m / 2 / g.line_pitch_m));
  const double kernels = independent_lines(u, g.line_pitch_m, lines);
  out["bound_m"] = displacement_bound_m(u, o.window_axial_m);
  out["window_bound_m"] = displacement_bound_m(u, o.window_axial_m) / std::sqrt(kernels);
  const double beams = std::max(1.0, kKernelLateralM / o.window_lateral_m);
  const auto filter = [&](bool companded) {
    return strain_filter(u, c.strain, o.window_axial_m, kKernelsM[4], kernels * beams, companded);
  };
  out["filter_snre"] = filter(false);
  out["companded_filter_snre"] = filter(true);
}

json measure_strain(const Track& t, const Phantom& p, const std::vector<double>& truth,
                    std::vector<std::vector<double>>& sums) {
  json out{{"snre", json::array()},
           {"cnre", json::array()},
           {"strain_rmse", json::array()},
           {"strain_bias", json::array()}};
  sums.resize(kKernelsM.size());
  for (std::size_t k = 0; k < kKernelsM.size(); ++k) {
    const std::vector<double> strain = axial_strain(t, kKernelsM[k], kKernelLateralM);
    const StrainQuality q = strain_quality(strain, truth, t.grid, p);
    out["snre"].push_back(q.snre);
    out["cnre"].push_back(q.cnre);
    out["strain_rmse"].push_back(q.rmse);
    out["strain_bias"].push_back(q.bias);
    if (sums[k].empty()) sums[k].assign(strain.size(), 0.0);
    for (std::size_t n = 0; n < strain.size(); ++n) sums[k][n] += strain[n];
  }
  return out;
}

// One method on one condition, seed after seed; what the edge is measured on is the mean over the seeds.
struct Series {
  json seeds = json::array();
  std::vector<std::vector<double>> sums;  // of the strain, per kernel
};

Track measure_seed(Tracker& tracker, const Phantom& p, const std::vector<double>& truth, Series& series) {
  const auto begin = std::chrono::steady_clock::now();
  const std::clock_t processor_begin = std::clock();
  Track t = tracker.track(p.pre, p.post, p.geometry);
  const double processor_s = static_cast<double>(std::clock() - processor_begin) / CLOCKS_PER_SEC;
  const double seconds = std::chrono::duration<double>(std::chrono::steady_clock::now() - begin).count();
  const TrackErrors e = track_errors(t, p);
  json seed = measure_strain(t, p, truth, series.sums);
  seed["seconds"] = seconds;
  seed["processor_s"] = processor_s;  // of all threads: ours runs on every core, the others on one
  seed["axial_rmse_m"] = e.axial_rmse_m;
  seed["axial_p95_m"] = e.axial_p95_m;
  seed["axial_max_m"] = e.axial_max_m;
  seed["lateral_rmse_m"] = e.lateral_rmse_m;
  seed["bias_m"] = e.bias_m;
  seed["valid_fraction"] = e.valid_fraction;
  seed["hop_fraction"] = e.hop_fraction;
  series.seeds.push_back(std::move(seed));
  return t;
}

// Standardised errors of one condition, seed after seed.
struct CalibrationSeries {
  std::vector<double> inside, outside;
  void add(const Track& t, const Phantom& p) {
    const Calibration z = standardised_errors(t, p);
    inside.push_back(z.inside), outside.push_back(z.outside);
  }
};

// Root mean square over the seeds and its 95 % interval.
json spread_of(const std::vector<double>& z) {
  std::vector<double> squares;
  squares.reserve(z.size());
  for (const double v : z) squares.push_back(v * v);
  const Interval i = interval95(squares);
  return {{"seeds", z},
          {"rms", std::sqrt(i.mean)},
          {"low", std::sqrt(std::max(0.0, i.mean - i.half_width))},
          {"high", std::sqrt(i.mean + i.half_width)}};
}

json describe(const CalibrationSeries& s) {
  return {{"inside", spread_of(s.inside)}, {"outside", spread_of(s.outside)}};
}

// Seeds `first` to kCalibrationSeeds of the default alone.
void calibrate_further(Tracker& tracker, Tracker& wide, const std::vector<Condition>& conditions,
                       std::uint64_t first, Phantoms& phantoms, std::vector<CalibrationSeries>& calibration) {
  for (std::uint64_t seed = first; seed <= kCalibrationSeeds; ++seed)
    for (std::size_t c = 0; c < conditions.size(); ++c) {
      const Phantom p = phantoms.make(conditions[c].of, seed);
      Tracker& searching = searches_wide(conditions[c].of, true) ? wide : tracker;
      calibration[c].add(searching.track(p.pre, p.post, p.geometry), p);
    }
}

json edges_of(const Series& series, const service::ImageGrid& grid, const Phantom& p) {
  json edges = json::array();
  for (std::vector<double> strain : series.sums) {
    for (double& s : strain) s /= static_cast<double>(series.seeds.size());
    const EdgeWidth w = edge_width(strain, grid, p);
    edges.push_back({{"axial_m", w.axial_m}, {"lateral_m", w.lateral_m}});
  }
  return edges;
}

bool brackets(const json& edges) {
  return number(edges.front().at("axial_m")) <= kEdgeM && number(edges.back().at("axial_m")) > kEdgeM;
}

// A strain image too noisy to read its edge width from would leave a peer without a figure: it gets the
// widths of the middle, which can only be sharper than what it did here.
void favour(const json& in_the_middle, json& method) {
  if (method.at("ours").get<bool>() || brackets(method.at("edges")) || !brackets(in_the_middle.at("edges")))
    return;
  method["edges"] = in_the_middle.at("edges");
  method["edges_of_middle"] = true;
}

json image_of_strain(const Track& t) {
  json out = json::array();
  for (const double s : axial_strain(t, kKernelsM[1], kKernelLateralM))
    out.push_back(std::isfinite(s) ? json(std::round(s * 1e6) / 1e6) : json());
  return out;
}

json images_of(const std::vector<std::unique_ptr<Tracker>>& trackers, const Phantom& p,
               const service::ImageGrid& grid, const std::vector<double>& truth) {
  json images{{"grid",
               {{"nx", grid.nx},
                {"ny", grid.ny},
                {"dx_m", grid.dx_m},
                {"dy_m", grid.dy_m},
                {"origin_x_m", grid.origin_x_m},
                {"origin_y_m", grid.origin_y_m}}},
              {"kernel_m", kKernelsM[1]},
              {"truth", truth},
              {"methods", json::array()}};
  for (const auto& tracker : trackers)
    images["methods"].push_back({{"method", tracker->name()},
                                 {"strain", image_of_strain(tracker->track(p.pre, p.post, p.geometry))}});
  return images;
}

}  // namespace

std::vector<double> strain_kernels_m() {
  return kKernelsM;
}

std::vector<Condition> chart_conditions(bool quick) {
  const PhantomCase middle;
  std::vector<Condition> all{{middle, {"middle", "strain", "snr", "correlation", "contrast", "diameter"}}};
  const auto sweep = [&](const char* factor, double PhantomCase::*member, const std::vector<double>& values) {
    for (const double v : values) {
      PhantomCase c = middle;
      c.*member = v;
      if (!(c == middle)) all.push_back({c, {factor}});
    }
  };
  using V = std::vector<double>;
  sweep("strain", &PhantomCase::strain,
        quick ? V{.001, .03, .05, .09} : V{.001, .005, .02, .03, .05, .06, .07, .08, .09});
  sweep("snr", &PhantomCase::snr_db, quick ? V{10} : V{10, 20, 40});
  sweep("correlation", &PhantomCase::correlation, quick ? V{.9} : V{1, .98, .95, .9});
  sweep("contrast", &PhantomCase::contrast, quick ? V{10} : V{.5, 2, 5, 10});
  sweep("diameter", &PhantomCase::diameter_m, quick ? V{5e-3} : V{5e-3, 8e-3, 15e-3});
  return all;
}

json measure_conditions(const std::vector<std::unique_ptr<Tracker>>& trackers,
                        const std::vector<std::unique_ptr<Tracker>>& wide, bool quick, json& images) {
  const std::vector<Condition> conditions = chart_conditions(quick);
  Phantoms phantoms;
  std::vector<std::vector<Series>> series(conditions.size(), std::vector<Series>(trackers.size()));
  std::vector<CalibrationSeries> calibration(conditions.size());
  std::vector<Phantom> last(conditions.size());
  const Nodes nodes(phantoms.make({}, 1).pre, phantoms.make({}, 1).geometry, TrackerOptions{}.grid_dx_m,
                    TrackerOptions{}.grid_dy_m);
  const std::uint64_t seeds = quick ? kQuickSeeds : kSeeds;
  for (std::uint64_t seed = 1; seed <= seeds; ++seed)  // outermost: the noise-free RF of a seed serves many
    for (std::size_t c = 0; c < conditions.size(); ++c) {
      Phantom p = phantoms.make(conditions[c].of, seed);
      const std::vector<double> truth = true_axial_strain(nodes.image, p);
      for (std::size_t m = 0; m < trackers.size(); ++m) {
        const bool far = searches_wide(conditions[c].of, trackers[m]->ours());
        const Track t = measure_seed(*(far ? wide : trackers)[m], p, truth, series[c][m]);
        if (m == 0) calibration[c].add(t, p);
      }
      if (c == 0 && seed == 1) images = images_of(trackers, p, nodes.image, truth);
      show_progress(fmt::format("seed {} of {}, condition {} of {}", seed, seeds, c + 1, conditions.size()));
      p.pre = p.post = {};
      last[c] = std::move(p);
    }
  if (!quick) calibrate_further(*trackers[0], *wide[0], conditions, seeds + 1, phantoms, calibration);
  json out = json::array();
  for (std::size_t c = 0; c < conditions.size(); ++c) {
    json condition{{"factors", conditions[c].factors},
                   {"case", describe(conditions[c].of)},
                   {"calibration", describe(calibration[c])},
                   {"methods", json::array()}};
    add_bounds(conditions[c].of, last[c].geometry, condition);
    for (std::size_t m = 0; m < trackers.size(); ++m) {
      json method{{"method", trackers[m]->name()},
                  {"ours", trackers[m]->ours()},
                  {"edges", edges_of(series[c][m], nodes.image, last[c])},
                  {"edges_of_middle", false},
                  {"seeds", series[c][m].seeds}};
      if (c > 0) favour(out[0]["methods"][m], method);
      condition["methods"].push_back(std::move(method));
    }
    out.push_back(std::move(condition));
  }
  return out;
}

}  // namespace teletact::bench
