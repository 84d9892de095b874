// teletact-bench real-tissue: the modulus of solids that are unlike what an estimator assumes, from RF,
// beside their truth; one level at a time, and all together.
#include <fmt/format.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <cmath>
#include <limits>
#include <map>
#include <set>

#include "bench/basics/clock.h"
#include "bench/basics/median.h"
#include "bench/suite.h"
#include "bench/suites/real_tissue/rows.h"
#include "client/patient/rf.h"
#include "client/patient/solid_press.h"
#include "client/patient/true_modulus.h"
#include "service/imaging/estimate.h"

namespace teletact::bench {
namespace {

constexpr double kQuantile = 1.96, kFromFaceM = 0.003, kInside = 0.7, kBeside = 1.3;
constexpr double kStatedPoissonRatio = 0.49;  // whatever is true
constexpr std::size_t kLeastSeeds = 10;       // of each row, for a share to mean anything
constexpr std::size_t kMostInMean = 400;      // nodes in the variance of a mean

struct RealOptions : SuiteOptions {
  std::size_t seeds = 20;
  double time_limit_s = 20;  // of the modulus
  std::string only;          // rows whose name has it
  bool promised = false;     // what the product is held to alone
};

// What a solid pressed between two frames gives, and its truth at the nodes.
struct Window {
  client::Tissue tissue;
  client::ProbeState state;
  client::RfPair rf;
  double sensed_force_n = 0, solve_s = 0;
};

Window window_of(const RealRow& row, std::uint64_t seed) {
  Window w;
  w.tissue = tissue_of(row, seed);
  const client::Tissue& t = w.tissue;
  w.solve_s = seconds_of(
      [&] { w.state = client::press_solid(t, (t.width_m - t.probe.width_m) / 2, t.probe.compression_m); });
  w.rf = client::with_noise(client::simulate_rf(t, w.state, client::RfFrame::kProbe, seed), seed + 1);
  w.sensed_force_n = client::sensed_force(t.probe, w.state.force_n, seed + 2);
  return w;
}

// What is stated of the tissue: its width where the probe is narrower, the depth that is imaged.
service::TissueExtent plane_strain(const Window& w) {
  const client::Tissue& t = w.tissue;
  return {t.width_m, t.imaged_depth_m(), w.state.window_x_m, kStatedPoissonRatio};
}

// The depth is stated where its bottom is imaged; the face is fitted.
service::TissueExtent solid(const Window& w) {
  service::TissueExtent extent = plane_strain(w);
  extent.plane = service::Plane::kSolid;
  extent.depth_stated = w.tissue.imaged_depth_m() == w.tissue.depth_m;
  return extent;
}

service::TissueExtent solid_fitted(const Window& w) {
  service::TissueExtent extent = solid(w);
  extent.depth_stated = false;
  return extent;
}

struct Estimator {
  std::string name;
  service::TissueExtent (*extent)(const Window&);
  bool promised;  // what the product is held to; else beside it
};

std::vector<Estimator> estimators() {
  return {
      {"solid", solid, true}, {"solid, fitted", solid_fitted, false}, {"plane strain", plane_strain, false}};
}

service::Estimate estimate(service::Elastography& elastography, const Window& w, const Estimator& by,
                           double time_limit_s) {
  const auto frame = [&](const std::vector<std::int16_t>& samples) {
    return service::RfFrame{
        w.rf.geometry.sample_count, w.rf.geometry.line_count, {samples.begin(), samples.end()}};
  };
  service::AcquisitionGeometry g;
  g.center_frequency_hz = w.tissue.ultrasound.center_frequency_hz;
  g.sampling_frequency_hz = w.tissue.ultrasound.sampling_frequency_hz;
  g.sound_speed_m_s = w.tissue.ultrasound.sound_speed_m_s;
  g.line_pitch_m = w.rf.geometry.line_pitch_m;
  return elastography.estimate({frame(w.rf.pre),
                                frame(w.rf.post),
                                g,
                                service::ProbeForce{w.sensed_force_n, w.state.contact_area_m2},
                                by.extent(w),
                                {},
                                {std::nullopt, time_limit_s}});
}

// Of one window by one estimator.
struct Figures {
  double background = kNan;  // over truth: the median where the truth is background
  double contrast = kNan;    // over truth: median inside over median of the background
  double ramp = kNan;        // background's lower third over its upper third
  double coverage = kNan;    // share of nodes whose truth is within 1.96 of what they state
  double lump_error = kNan, lump_deviation = kNan;              // ln of the mean modulus inside, and stated
  double background_error = kNan, background_deviation = kNan;  // the same beside it
  double deviation = kNan;                                      // median stated
  double off = kNan;                                            // 95 % of the nodes are off by less, |ln|
  double tracking_m = kNan;                                     // median error of the axial displacement
  double seconds = 0, modulus_s = 0;
  std::set<service::ModulusFlag> said;
};

// Median of what the tracked axial displacement is off by, where it is trusted.
double tracking_error(const service::Estimate& e, const Window& w) {
  std::vector<double> off_m;
  for (std::size_t n = 0; n < e.grid.size(); ++n) {
    if (!e.displacement_valid[n]) continue;
    const double x = w.state.window_x_m + e.grid.x_m(n), y = e.grid.y_m(n);
    const double truth_m = w.state.field->at(x, y).y - w.state.motion(x, y).y;
    off_m.push_back(std::abs(e.axial_displacement[n] - truth_m));
  }
  return median_of(off_m);
}

// A mean over nodes of errors that correlate by exp(-distance / length).
void mean_of(const service::Estimate& e, const std::vector<double>& error, std::vector<std::size_t> nodes,
             double& mean, double& deviation) {
  if (nodes.empty()) return;
  const std::size_t step = 1 + nodes.size() / kMostInMean;
  std::vector<std::size_t> some;
  for (std::size_t n = 0; n < nodes.size(); n += step) some.push_back(nodes[n]);
  double sum = 0, variance = 0;
  for (const std::size_t a : some) {
    sum += error[a];
    for (const std::size_t b : some)
      variance += e.modulus_log_deviation[a] * e.modulus_log_deviation[b] *
                  std::exp(-std::hypot(e.grid.x_m(a) - e.grid.x_m(b), e.grid.y_m(a) - e.grid.y_m(b)) /
                           e.modulus_correlation_m);
  }
  mean = sum / static_cast<double>(some.size());
  deviation = std::sqrt(variance) / static_cast<double>(some.size());
}

Figures judge(const service::Estimate& e, const Window& w) {
  const client::TrueModulus truth(w.tissue);
  const double left_m = w.state.window_x_m;
  std::vector<double> error(e.grid.size(), kNan), beside, inside, above, below, deviations, offs;
  std::vector<std::size_t> beside_nodes, inside_nodes;
  double held = 0, judged = 0, deepest_m = 0;
  std::vector<std::pair<double, double>> by_depth;
  for (std::size_t n = 0; n < e.grid.size(); ++n) {
    const double x = left_m + e.grid.x_m(n), y = e.grid.y_m(n), modulus = e.youngs_modulus[n];
    if (y < kFromFaceM || !std::isfinite(modulus)) continue;
    error[n] = std::log(modulus / truth(x, y));
    offs.push_back(std::abs(error[n]));
    const double stated = e.modulus_log_deviation[n];
    ++judged, held += std::abs(error[n]) <= kQuantile * stated;
    deviations.push_back(stated);
    double radii = std::numeric_limits<double>::infinity();
    for (const client::Inclusion& i : w.tissue.inclusions)
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
  Figures f;
  f.tracking_m = tracking_error(e, w);
  f.background = median_of(beside);
  if (!inside.empty()) f.contrast = median_of(inside) / f.background;
  f.ramp = median_of(below) / median_of(above);
  f.coverage = held / judged;
  f.deviation = median_of(deviations);
  f.off = quantiles(offs).p95;
  mean_of(e, error, inside_nodes, f.lump_error, f.lump_deviation);
  mean_of(e, error, beside_nodes, f.background_error, f.background_deviation);
  return f;
}

// Of one row by one estimator, over its seeds: medians, and the farthest from the truth.
struct RealResult {
  std::string name, estimator;
  double contrast_of_lump = 1;
  std::size_t seeds = 0, refused = 0;
  double background = kNan, background_worst = kNan, contrast = kNan, contrast_worst = kNan;
  double ramp = kNan, ramp_worst = kNan, off = kNan, coverage = kNan, deviation = kNan;
  std::size_t background_held = 0, lump_held = 0;  // windows whose stated 95 % interval has the truth
  double tracking_m = kNan, seconds = kNan, modulus_s = kNan;
  std::string said = {};  // warnings, and in how many windows: "misfit 2, ramp 6"
};
NLOHMANN_DEFINE_TYPE_NON_INTRUSIVE(RealResult, name, estimator, contrast_of_lump, seeds, refused, background,
                                   background_worst, contrast, contrast_worst, ramp, ramp_worst, off,
                                   coverage, deviation, background_held, lump_held, tracking_m, seconds,
                                   modulus_s, said)
// The same of the promised estimator, for a page that people read.
struct RealLine {
  std::string row, background, contrast, ramp, held, said;
  double coverage = kNan, seconds = kNan;
};
NLOHMANN_DEFINE_TYPE_NON_INTRUSIVE(RealLine, row, background, contrast, ramp, held, said, coverage, seconds)
struct RealFigures {
  std::vector<RealResult> rows;
  std::vector<RealLine> without_lump, lump_of_3, lump_of_5;
};
NLOHMANN_DEFINE_TYPE_NON_INTRUSIVE(RealFigures, rows, without_lump, lump_of_3, lump_of_5)

double worst_of(const std::vector<double>& ratios) {
  double worst = kNan;
  for (const double r : ratios)
    if (!(std::abs(std::log(r)) <= std::abs(std::log(worst)))) worst = r;
  return worst;
}

RealResult summary(const RealRow& row, const std::string& estimator, const std::vector<Figures>& seeds,
                   std::size_t refused) {
  const auto all = [&](double Figures::*member) {
    std::vector<double> values;
    values.reserve(seeds.size());
    for (const Figures& f : seeds) values.push_back(f.*member);
    return values;
  };
  RealResult r{.name = row.name, .estimator = estimator, .contrast_of_lump = row.contrast};
  r.seeds = seeds.size() + refused, r.refused = refused;
  r.background = median_of(all(&Figures::background)),
  r.background_worst = worst_of(all(&Figures::background));
  r.contrast = median_of(all(&Figures::contrast)), r.contrast_worst = worst_of(all(&Figures::contrast));
  r.ramp = median_of(all(&Figures::ramp)), r.ramp_worst = worst_of(all(&Figures::ramp));
  r.off = median_of(all(&Figures::off));
  r.coverage = median_of(all(&Figures::coverage)), r.deviation = median_of(all(&Figures::deviation));
  std::map<std::string, std::size_t> said;
  for (const Figures& f : seeds) {
    r.background_held += std::abs(f.background_error) <= kQuantile * f.background_deviation;
    r.lump_held += std::abs(f.lump_error) <= kQuantile * f.lump_deviation;
    for (const service::ModulusFlag flag : f.said) ++said[service::name_of(flag)];
  }
  for (const auto& [warning, windows] : said)
    r.said += fmt::format("{}{} {}", r.said.empty() ? "" : ", ", warning, windows);
  r.tracking_m = median_of(all(&Figures::tracking_m));
  r.seconds = median_of(all(&Figures::seconds)), r.modulus_s = median_of(all(&Figures::modulus_s));
  return r;
}

constexpr const char* kLine =
    "{:<50} {:<14} {:>4} {:>13} {:>13} {:>13} {:>5} {:>8} {:>6} {:>9} {:>7} {:>5}{}\n";

void print_head() {
  fmt::print(kLine, "median (worst) over truth", "estimator", "lump", "background", "contrast", "ramp", "off",
             "coverage", "stated", "held", "um off", "s", "");
}

std::string pair(double median, double worst) {
  return std::isfinite(median) ? fmt::format("{:.2f} ({:.2f})", median, worst) : "-";
}

// Backgrounds, and lumps where there are.
std::string held(const RealResult& r) {
  return r.contrast_of_lump == 1 ? fmt::format("{}/{}", r.background_held, r.seeds)
                                 : fmt::format("{},{}/{}", r.background_held, r.lump_held, r.seeds);
}

RealLine line_of(const RealResult& r) {
  return {r.name,
          pair(r.background, r.background_worst),
          pair(r.contrast, r.contrast_worst),
          pair(r.ramp, r.ramp_worst),
          held(r),
          r.said,
          r.coverage,
          r.seconds};
}

void print(const RealResult& r) {
  const auto number = [](double value, int digits) { return fmt::format("{:.{}f}", value, digits); };
  const bool lump = r.contrast_of_lump != 1;
  fmt::print(kLine, r.name, r.estimator, lump ? number(r.contrast_of_lump, 0) : "-",
             pair(r.background, r.background_worst), pair(r.contrast, r.contrast_worst),
             pair(r.ramp, r.ramp_worst), number(r.off, 2), number(r.coverage, 2), number(r.deviation, 2),
             held(r), number(1e6 * r.tracking_m, 2), number(r.seconds, 1),
             r.refused > 0 ? fmt::format(", {} refused", r.refused) : "");
  if (!r.said.empty()) fmt::print("    said: {}\n", r.said);
  std::fflush(stdout);
}

// Of the rows by estimators that are held to something.
void promise(const std::vector<RealResult>& rows, Promises& promises) {
  constexpr double kContrastOff = 0.15, kLeastHeld = 0.8;
  double background = 0, ramp = 1, least = 1, windows = 0, held = 0, without = 0;
  const auto ratio = [](double r) { return std::exp(std::abs(std::log(r))); };
  for (const RealResult& r : rows) {
    const auto seeds = static_cast<double>(r.seeds);
    const bool lump = r.contrast_of_lump != 1;
    background = std::max(background, std::abs(r.background - 1));
    if (!lump) ramp = std::max(ramp, ratio(r.ramp));
    const double lump_held = static_cast<double>(r.lump_held),
                 background_held = static_cast<double>(r.background_held);
    least = std::min(least, background_held / seeds), windows += seeds, held += background_held;
    if (!lump) continue;
    least = std::min(least, lump_held / seeds), windows += seeds, held += lump_held;
    without += !(std::abs(r.contrast - 1) <= kContrastOff || lump_held >= kLeastHeld * seeds);
  }
  if (windows == 0) return;
  promises.push_back({"background_of_the_worst_row_off_by", background, 0.1});
  promises.push_back({"ramp_of_the_worst_row_without_a_lump", ramp, 1.15});
  promises.push_back({"rows_whose_contrast_is_neither_within_15_percent_nor_in_its_interval", without, 0});
  promises.push_back({"least_share_of_a_row_in_its_95_percent_interval", least, kLeastHeld, "", false});
  promises.push_back({"pooled_share_in_the_95_percent_interval_at_least", held / windows, 0.92, "", false});
  promises.push_back({"pooled_share_in_the_95_percent_interval_at_most", held / windows, 0.98});
}

RealFigures measure(const RealOptions& options, Promises& promises) {
  service::Elastography elastography(service::Device::open());
  elastography.warm();
  const std::size_t seeds = options.quick ? 1 : options.seeds;
  std::vector<Estimator> all = estimators();
  if (options.promised) std::erase_if(all, [](const Estimator& e) { return !e.promised; });
  RealFigures figures;
  std::vector<RealResult> held_to;
  print_head();
  for (const RealRow& row : real_rows()) {
    if ((options.quick && !row.quick) || row.name.find(options.only) == std::string::npos) continue;
    std::vector<std::vector<Figures>> of(all.size());
    std::vector<std::size_t> refused(all.size(), 0);
    for (std::uint64_t seed = 1; seed <= seeds; ++seed) {
      const Window w = window_of(row, seed);
      show_progress(fmt::format("{}, contrast {}: seed {} of {}, solved in {:.1f} s", row.name, row.contrast,
                                seed, seeds, w.solve_s));
      for (std::size_t k = 0; k < all.size(); ++k) {
        service::Estimate e;
        try {
          const double seconds =
              seconds_of([&] { e = estimate(elastography, w, all[k], options.time_limit_s); });
          of[k].push_back(judge(e, w));
          of[k].back().seconds = seconds, of[k].back().modulus_s = e.modulus_s;
          for (const service::ModulusWarning& w : e.modulus_warnings) of[k].back().said.insert(w.flag);
        } catch (const std::exception& error) {
          ++refused[k];
          fmt::print("{}, contrast {}, seed {}, {}: {}\n", row.name, row.contrast, seed, all[k].name,
                     error.what());
        }
      }
    }
    for (std::size_t k = 0; k < all.size(); ++k) {
      figures.rows.push_back(summary(row, all[k].name, of[k], refused[k]));
      print(figures.rows.back());
      if (!all[k].promised) continue;
      held_to.push_back(figures.rows.back());
      (row.contrast == 1   ? figures.without_lump
       : row.contrast == 3 ? figures.lump_of_3
                           : figures.lump_of_5)
          .push_back(line_of(held_to.back()));
    }
  }
  if (seeds >= kLeastSeeds) promise(held_to, promises);
  return figures;
}

}  // namespace

void add_real_tissue_suite(CLI::App& app, bool& met) {
  const auto options = std::make_shared<RealOptions>();
  CLI::App& suite = add_suite(app, "real-tissue", "the modulus of solids unlike what the estimator assumes",
                              options, met, measure, [](const RealFigures&, const std::filesystem::path&) {});
  suite.add_option("--seeds", options->seeds, "of each row")
      ->check(CLI::Range(1, 1000))
      ->capture_default_str();
  suite.add_option("--modulus-time-limit-s", options->time_limit_s, "as of estimate")->capture_default_str();
  suite.add_option("--only", options->only, "rows whose name has this");
  suite.add_flag("--promised", options->promised, "no estimators beside the one that is promised");
}

}  // namespace teletact::bench
