// One factor at a time from the middle (T2.7): 1 % compression, 30 dB, rho 0.99, contrast 3, 10 mm.
#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <ctime>

#include "bench/basics/clock.h"
#include "bench/peers/rf_nodes.h"
#include "bench/phantoms/bounds.h"
#include "bench/suites/elastography/elastography.h"

namespace teletact::bench {
namespace {

const std::vector<double> kKernelsM{1.2e-3, 2.0e-3, 2.8e-3, 3.6e-3, 4.4e-3, 5.2e-3};
constexpr std::uint64_t kSeeds = 6, kQuickSeeds = 2;
// Of the default's standardised errors: inside an inclusion there are few independent ones in an image, so
// that their deviation differs by 0.1 to 0.3 from seed to seed.
constexpr std::uint64_t kCalibrationSeeds = 24;

// Bounds of one kernel with the windows of all methods, and the strain that it allows with the kernel that a
// plain window needs for the edge width of the comparison.
Condition condition_of(const PhantomCase& c, std::vector<std::string> factors, double line_pitch_m) {
  client::Ultrasound u;
  u.snr_db = c.snr_db;
  u.correlation = c.correlation;
  const TrackerOptions o;
  const double kernels = window_lines(u, o.window_lateral_m, line_pitch_m);
  const double bound_m = displacement_bound_m(u, o.window_axial_m);
  const double beams = std::max(1.0, kKernelLateralM / o.window_lateral_m);
  const auto filter = [&](bool companded) {
    return strain_filter(u, c.strain, o.window_axial_m, kKernelsM[4], kernels * beams, companded);
  };
  return {c,       std::move(factors),           max_strain_of(c, true), max_strain_of(c, false),
          bound_m, bound_m / std::sqrt(kernels), filter(false),          filter(true)};
}

std::vector<Condition> chart_conditions(bool quick, double line_pitch_m) {
  const PhantomCase middle;
  std::vector<Condition> all{
      condition_of(middle, {"middle", "strain", "snr", "correlation", "contrast", "diameter"}, line_pitch_m)};
  const auto sweep = [&](const char* factor, double PhantomCase::*member, const std::vector<double>& values) {
    for (const double v : values) {
      PhantomCase c = middle;
      c.*member = v;
      if (!(c == middle)) all.push_back(condition_of(c, {factor}, line_pitch_m));
    }
  };
  using V = std::vector<double>;
  sweep("strain", &PhantomCase::strain,
        quick ? V{0.001, 0.03, 0.05, 0.09} : V{0.001, 0.005, 0.02, 0.03, 0.05, 0.06, 0.07, 0.08, 0.09});
  sweep("snr", &PhantomCase::snr_db, quick ? V{10} : V{10, 20, 40});
  sweep("correlation", &PhantomCase::correlation, quick ? V{0.9} : V{1, 0.98, 0.95, 0.9});
  sweep("contrast", &PhantomCase::contrast, quick ? V{10} : V{0.5, 2, 5, 10});
  sweep("diameter", &PhantomCase::diameter_m, quick ? V{5e-3} : V{5e-3, 8e-3, 15e-3});
  return all;
}

// Of the strain per kernel, summed over the seeds: what the edge is measured on is their mean.
using StrainSums = std::vector<std::vector<double>>;

std::vector<StrainQuality> measure_strain(const Track& t, const Phantom& p, const std::vector<double>& truth,
                                          StrainSums& sums) {
  std::vector<StrainQuality> out;
  sums.resize(kKernelsM.size());
  for (std::size_t k = 0; k < kKernelsM.size(); ++k) {
    const std::vector<double> strain = axial_strain(t, kKernelsM[k], kKernelLateralM);
    out.push_back(strain_quality(strain, truth, t.grid, p));
    sums[k].resize(strain.size(), 0.0);
    for (std::size_t n = 0; n < strain.size(); ++n) sums[k][n] += strain[n];
  }
  return out;
}

Track measure_seed(const Tracker& tracker, const Phantom& p, const std::vector<double>& truth,
                   std::vector<SeedFigures>& seeds, StrainSums& sums) {
  Track t;
  const std::clock_t processor_begin = std::clock();
  const double seconds = seconds_of([&] { t = tracker.track(p.pre, p.post, p.geometry); });
  const double processor_s = static_cast<double>(std::clock() - processor_begin) / CLOCKS_PER_SEC;
  seeds.push_back({seconds, processor_s, track_errors(t, p), measure_strain(t, p, truth, sums)});
  return t;
}

void add_errors(const Track& t, const Phantom& p, CalibrationFigures& calibration) {
  const Calibration z = standardised_errors(t, p);
  calibration.inside.seeds.push_back(z.inside), calibration.outside.seeds.push_back(z.outside);
}

// Seeds `first` to kCalibrationSeeds of the default alone.
void calibrate_further(const Trackers& trackers, std::uint64_t first, Phantoms& phantoms,
                       std::vector<Condition>& conditions) {
  for (std::uint64_t seed = first; seed <= kCalibrationSeeds; ++seed)
    for (Condition& c : conditions) {
      const Phantom p = phantoms.make(c.of, seed);
      add_errors(trackers.of(0, c.of).track(p.pre, p.post, p.geometry), p, c.calibration);
    }
}

void summarise(Spread& spread) {
  std::vector<double> squares;
  for (const double z : spread.seeds) squares.push_back(z * z);
  const Interval i = interval95(squares);
  spread.rms = std::sqrt(i.mean);
  spread.low = std::sqrt(std::max(0.0, i.mean - i.half_width));
  spread.high = std::sqrt(i.mean + i.half_width);
}

std::vector<EdgeWidth> edges_of(const StrainSums& sums, std::size_t seeds, const service::ImageGrid& grid,
                                const Phantom& p) {
  std::vector<EdgeWidth> edges;
  for (std::vector<double> strain : sums) {
    for (double& s : strain) s /= static_cast<double>(seeds);
    edges.push_back(edge_width(strain, grid, p));
  }
  return edges;
}

bool brackets(const std::vector<EdgeWidth>& edges) {
  return edges.front().axial_m <= kEdgeM && edges.back().axial_m > kEdgeM;
}

// A strain image too noisy to read its edge width from would leave a peer without a figure: it gets the
// widths of the middle, which can only be sharper than what it did here.
void favour(const TrackerFigures& in_the_middle, TrackerFigures& method) {
  if (method.ours || brackets(method.edges) || !brackets(in_the_middle.edges)) return;
  method.edges = in_the_middle.edges;
  method.edges_of_middle = true;
}

StrainImages images_of(const Trackers& trackers, const Phantom& p, const service::ImageGrid& grid,
                       const std::vector<double>& truth) {
  StrainImages images{grid, kKernelsM[1], {{"truth", truth}}};
  for (const Tracker& tracker : trackers.usual) {
    const Track t = tracker.track(p.pre, p.post, p.geometry);
    images.strain.push_back({tracker.name, axial_strain(t, kKernelsM[1], kKernelLateralM)});
    for (double& s : images.strain.back().values) s = std::round(s * 1e6) / 1e6;
  }
  return images;
}

}  // namespace

std::vector<double> strain_kernels_m() {
  return kKernelsM;
}

std::vector<Condition> measure_conditions(const Trackers& trackers, bool quick, StrainImages& images) {
  Phantoms phantoms;
  const Phantom any = phantoms.make({}, 1);
  const Nodes nodes(any.pre, any.geometry, TrackerOptions{}.grid_dx_m, TrackerOptions{}.grid_dy_m);
  std::vector<Condition> conditions = chart_conditions(quick, any.geometry.line_pitch_m);
  std::vector<std::vector<StrainSums>> sums(conditions.size(),
                                            std::vector<StrainSums>(trackers.usual.size()));
  std::vector<Phantom> last(conditions.size());
  for (Condition& c : conditions)
    for (const Tracker& tracker : trackers.usual) c.methods.push_back({tracker.name, tracker.ours});
  const std::uint64_t seeds = quick ? kQuickSeeds : kSeeds;
  for (std::uint64_t seed = 1; seed <= seeds; ++seed)  // outermost: the noise-free RF of a seed serves many
    for (std::size_t c = 0; c < conditions.size(); ++c) {
      Condition& condition = conditions[c];
      Phantom p = phantoms.make(condition.of, seed);
      const std::vector<double> truth = true_axial_strain(nodes.image, p);
      for (std::size_t m = 0; m < condition.methods.size(); ++m) {
        const Track t =
            measure_seed(trackers.of(m, condition.of), p, truth, condition.methods[m].seeds, sums[c][m]);
        if (m == 0) add_errors(t, p, condition.calibration);
      }
      if (c == 0 && seed == 1) images = images_of(trackers, p, nodes.image, truth);
      show_progress(fmt::format("seed {} of {}, condition {} of {}", seed, seeds, c + 1, conditions.size()));
      p.pre = p.post = {};
      last[c] = std::move(p);
    }
  if (!quick) calibrate_further(trackers, seeds + 1, phantoms, conditions);
  for (std::size_t c = 0; c < conditions.size(); ++c) {
    summarise(conditions[c].calibration.inside);
    summarise(conditions[c].calibration.outside);
    for (std::size_t m = 0; m < trackers.usual.size(); ++m) {
      TrackerFigures& method = conditions[c].methods[m];
      method.edges = edges_of(sums[c][m], seeds, nodes.image, last[c]);
      if (c > 0) favour(conditions.front().methods[m], method);
    }
  }
  return conditions;
}

}  // namespace teletact::bench
