// teletact-bench real-tissue: the modulus of solids that are unlike what an estimator assumes, from RF,
// beside their truth; one level at a time, and all together.
#include <fmt/format.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <cmath>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <map>
#include <numeric>
#include <set>
#include <span>
#include <tuple>
#include <utility>

#include "bench/basics/median.h"
#include "bench/run_suite.h"
#include "bench/suites/real_tissue/windows.h"
#include "client/files/metaimage.h"
#include "client/patient/solid_press.h"

namespace teletact::bench {

NLOHMANN_DEFINE_TYPE_NON_INTRUSIVE(RealWindow, row, estimator, contrast_of_lump, seed, refused, background,
                                   contrast, ramp, coverage, lump_error, lump_deviation, background_error,
                                   background_deviation, deviation, off, skin_held, tracking_m, seconds,
                                   processor_s, modulus_s, truth_s, said)

namespace {

// Of each row, for a share to mean anything; of the patients', whose shares are of windows, five. Of the
// independent rows, whose share is of nodes, no more than ten are tried, and two are enough.
constexpr std::size_t kMinSeeds = 10, kMinPatientSeeds = 5, kMinIndependentSeeds = 2;

struct RealOptions : SuiteOptions {
  std::size_t seeds = 20;
  std::uint64_t first_seed = 1;
  std::vector<std::string> windows_of;  // --json of earlier runs
  double spacing_m = client::kSolidSpacing;
  std::string only;       // rows whose name has it
  std::string keep;       // a folder for the pairs
  bool promised = false;  // what the product is held to alone
};

// Of one row by one estimator, over its seeds: medians, and the farthest from the truth.
struct RealResult {
  std::string name, estimator;
  double contrast_of_lump = 1;
  std::size_t seeds = 0, refused = 0;
  double background = kNan, background_worst = kNan, contrast = kNan, contrast_worst = kNan;
  double ramp = kNan, ramp_worst = kNan, off = kNan, deviation = kNan;
  double coverage = kNan, coverage_worst = kNan;   // mean, least
  double deviation_spread = kNan;                  // the largest over the least
  double skin_held = kNan;                         // of the worst window
  std::size_t background_held = 0, lump_held = 0;  // windows whose stated 95 % interval has the truth
  double tracking_m = kNan, seconds = kNan, processor_s = kNan, modulus_s = kNan;
  std::string said = {};  // warnings, and in how many windows: "misfit 2, ramp 6"
};
NLOHMANN_DEFINE_TYPE_NON_INTRUSIVE(RealResult, name, estimator, contrast_of_lump, seeds, refused, background,
                                   background_worst, contrast, contrast_worst, ramp, ramp_worst, off,
                                   coverage, coverage_worst, deviation, deviation_spread, skin_held,
                                   background_held, lump_held, tracking_m, seconds, processor_s, modulus_s,
                                   said)
// What of it people read on a page, of the promised estimator; lumps of 5 are among the rows alone.
struct RealLine {
  std::string row, background, contrast, ramp, coverage, held, said;
  double skin_held = kNan;
};
NLOHMANN_DEFINE_TYPE_NON_INTRUSIVE(RealLine, row, background, contrast, ramp, coverage, held, said, skin_held)
struct RealFigures {
  std::vector<RealResult> rows;
  std::vector<RealLine> without_lump, lump_of_3, independent;
  std::vector<RealWindow> windows;
  double truth_spacing_m = kNan;
};
NLOHMANN_DEFINE_TYPE_NON_INTRUSIVE(RealFigures, truth_spacing_m, rows, without_lump, lump_of_3, independent,
                                   windows)

double worst_of(const std::vector<double>& ratios) {
  double worst = kNan;
  for (const double r : ratios)
    if (!(std::abs(std::log(r)) <= std::abs(std::log(worst)))) worst = r;
  return worst;
}

// `windows`: some, of one row by one estimator.
RealResult summary(const std::vector<RealWindow>& windows) {
  const auto all = [&](double RealWindow::*member) {
    std::vector<double> values;
    for (const RealWindow& w : windows)
      if (!w.refused) values.push_back(w.*member);
    return values;
  };
  RealResult r{.name = windows.front().row,
               .estimator = windows.front().estimator,
               .contrast_of_lump = windows.front().contrast_of_lump};
  r.seeds = windows.size();
  r.background = median_of(all(&RealWindow::background)),
  r.background_worst = worst_of(all(&RealWindow::background));
  r.contrast = median_of(all(&RealWindow::contrast)), r.contrast_worst = worst_of(all(&RealWindow::contrast));
  r.ramp = median_of(all(&RealWindow::ramp)), r.ramp_worst = worst_of(all(&RealWindow::ramp));
  r.off = median_of(all(&RealWindow::off));
  const std::vector<double> coverage = all(&RealWindow::coverage), deviation = all(&RealWindow::deviation);
  r.deviation = median_of(deviation);
  if (!coverage.empty()) {
    r.coverage = std::accumulate(coverage.begin(), coverage.end(), 0.) / static_cast<double>(coverage.size());
    r.coverage_worst = std::ranges::min(coverage);
    r.deviation_spread = std::ranges::max(deviation) / std::ranges::min(deviation);
  }
  for (const double share : all(&RealWindow::skin_held)) r.skin_held = std::fmin(r.skin_held, share);
  std::map<std::string, std::size_t> said;
  for (const RealWindow& w : windows) {
    r.refused += w.refused;
    r.background_held += std::abs(w.background_error) <= kQuantile * w.background_deviation;
    r.lump_held += std::abs(w.lump_error) <= kQuantile * w.lump_deviation;
    for (const std::string& warning : w.said) ++said[warning];
  }
  for (const auto& [warning, count] : said)
    r.said += fmt::format("{}{} {}", r.said.empty() ? "" : ", ", warning, count);
  r.tracking_m = median_of(all(&RealWindow::tracking_m));
  r.seconds = median_of(all(&RealWindow::seconds)), r.processor_s = median_of(all(&RealWindow::processor_s)),
  r.modulus_s = median_of(all(&RealWindow::modulus_s));
  return r;
}

constexpr const char* kLine =
    "{:<50} {:<14} {:>4} {:>13} {:>13} {:>13} {:>5} {:>13} {:>13} {:>9} {:>7} {:>5}{}\n";

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
  return {r.name.starts_with(kIndependent) ? r.name.substr(kIndependent.size()) : r.name,
          pair(r.background, r.background_worst),
          pair(r.contrast, r.contrast_worst),
          pair(r.ramp, r.ramp_worst),
          pair(r.coverage, r.coverage_worst),
          held(r),
          r.said,
          r.skin_held};
}

void print(const RealResult& r) {
  const auto number = [](double value, int digits) { return fmt::format("{:.{}f}", value, digits); };
  const bool lump = r.contrast_of_lump != 1;
  fmt::print(kLine, r.name, r.estimator, lump ? number(r.contrast_of_lump, 0) : "-",
             pair(r.background, r.background_worst), pair(r.contrast, r.contrast_worst),
             pair(r.ramp, r.ramp_worst), number(r.off, 2), pair(r.coverage, r.coverage_worst),
             fmt::format("{:.3f} (x{:.2f})", r.deviation, r.deviation_spread), held(r),
             number(1e6 * r.tracking_m, 2), number(r.seconds, 1),
             r.refused > 0 ? fmt::format(", {} refused", r.refused) : "");
  if (!r.said.empty()) fmt::print("    said: {}\n", r.said);
  std::fflush(stdout);
}

// Of the rows by estimators that are held to something.
void promise(const std::vector<RealResult>& rows, Promises& promises) {
  constexpr double kContrastOff = 0.15, kMinHeld = 0.8;
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
    without += !(std::abs(r.contrast - 1) <= kContrastOff || lump_held >= kMinHeld * seeds);
  }
  if (windows == 0) return;
  promises.push_back({"background_of_the_worst_row_off_by", background, 0.1});
  promises.push_back({"ramp_of_the_worst_row_without_a_lump", ramp, 1.15});
  promises.push_back({"rows_whose_contrast_is_neither_within_15_percent_nor_in_its_interval", without, 0});
  promises.push_back({"min_share_of_a_row_in_its_95_percent_interval", least, kMinHeld, "", false});
  promises.push_back({"pooled_share_in_the_95_percent_interval_at_least", held / windows, 0.92, "", false});
  promises.push_back({"pooled_share_in_the_95_percent_interval_at_most", held / windows, 0.98});
}

// Of the rows by independent means, wide and not.
void promise_independent(const std::vector<RealResult>& wide, const std::vector<RealResult>& beside,
                         Promises& promises) {
  constexpr double kOff = 0.1, kMinHeld = 0.85;
  double background = 0, contrast = kNan, pooled = 0, seeds = 0, least = 1, spread = 1, without = 0;
  std::size_t refused = 0;
  for (const std::vector<RealResult>* rows : {&wide, &beside})
    for (const RealResult& r : *rows) {
      const auto judged = static_cast<double>(r.seeds - r.refused);
      if (judged > 0) pooled += r.coverage * judged, seeds += judged;
      refused += r.refused;
      least = std::min(least, r.coverage_worst), spread = std::max(spread, r.deviation_spread);
      if (r.contrast_of_lump != 1) contrast = std::fmax(contrast, std::abs(r.contrast - 1));
    }
  if (wide.empty() && beside.empty()) return;
  for (const RealResult& r : wide) background = std::max(background, std::abs(r.background - 1));
  for (const RealResult& r : beside)
    without += !(std::abs(r.background_worst - 1) <= kOff ||
                 (r.coverage_worst >= kMinHeld && r.background_held == r.seeds));
  promises.push_back({"independent_windows_refused", static_cast<double>(refused), 0});
  promises.push_back(
      {"independent_nodes_in_their_95_percent_interval_at_least", pooled / seeds, 0.92, "", false});
  promises.push_back({"independent_nodes_in_their_95_percent_interval_at_most", pooled / seeds, 0.98});
  promises.push_back({"independent_nodes_of_the_worst_pair_in_it", least, kMinHeld, "", false});
  if (!wide.empty())
    promises.push_back({"independent_background_of_the_worst_wide_row_off_by", background, 0.03});
  if (!std::isnan(contrast))
    promises.push_back({"independent_contrast_of_the_worst_row_off_by", contrast, 0.07});
  if (!beside.empty())
    promises.push_back(
        {"independent_rows_beside_neither_within_10_percent_nor_in_their_interval", without, 0});
  promises.push_back({"independent_stated_deviation_over_speckle_max_over_min", spread, 1.3});
}

// Of rows in which what is stated is wrong: that the interval holds, and that it is said.
void promise_of_wrong_statements(const std::vector<RealResult>& rows, const std::vector<RealWindow>& windows,
                                 Promises& promises) {
  double held = 1, unsaid = 0;
  for (const RealResult& r : rows) {
    held = std::min(held, r.refused > 0 ? 0 : r.coverage_worst);
    const auto silent = std::ranges::count_if(windows, [&](const RealWindow& w) {
      return w.row == r.name && w.estimator == r.estimator && std::ranges::count(w.said, "elevation") == 0;
    });
    unsaid = std::max(unsaid, static_cast<double>(silent) / static_cast<double>(r.seeds));
  }
  promises.push_back({"independent_nodes_held_where_what_is_stated_is_wrong", held, 0.92, "", false});
  promises.push_back({"wrong_statements_of_the_worst_row_not_said", unsaid, 0.1});
}

// Of a pair, for `teletact-client estimate` and others.
void keep(const Window& w, const std::filesystem::path& folder) {
  std::filesystem::create_directories(folder);
  for (const auto& [name, frame] : {std::pair{"pre.mha", &w.pre}, {"post.mha", &w.post}}) {
    const std::vector<std::int16_t> samples(frame->samples.begin(), frame->samples.end());
    client::write_metaimage(
        folder / name, client::MetaImage::of({frame->sample_count, frame->line_count},
                                             {w.geometry.sample_pitch_m(), w.geometry.line_pitch_m}, {0, 0},
                                             std::span<const std::int16_t>(samples)));
  }
  const nlohmann::json truth{{"dF", w.force.force_n}, {"unit", "N"}};
  if (!(std::ofstream(folder / "truth.json") << truth << '\n' << std::flush))
    throw BenchError("cannot write into --keep " + folder.string());
}

// Those of earlier runs. Throws BenchError for a window that is there twice, or has another truth.
std::vector<RealWindow> earlier_windows(const RealOptions& options) {
  std::vector<RealWindow> all;
  std::set<std::tuple<std::string, double, std::string, std::uint64_t>> known;
  for (const std::string& file : options.windows_of) {
    SuiteOptions earlier = options;
    earlier.replot = file, earlier.out = ".";  // nothing is drawn there
    RealFigures figures = earlier_figures("real-tissue", earlier).get<RealFigures>();
    if (figures.truth_spacing_m != options.spacing_m)
      throw BenchError(fmt::format("--windows-of {}: its truth has --truth-spacing-m {}, not {}", file,
                                   figures.truth_spacing_m, options.spacing_m));
    for (RealWindow& w : figures.windows) {
      if (!known.emplace(w.row, w.contrast_of_lump, w.estimator, w.seed).second)
        throw BenchError(fmt::format("--windows-of {}: seed {} of \"{}\" is in another of the files, too",
                                     file, w.seed, w.row));
      all.push_back(std::move(w));
    }
  }
  return all;
}

RealFigures measure(const RealOptions& options, Promises& promises) {
  RealFigures figures;
  figures.windows = earlier_windows(options), figures.truth_spacing_m = options.spacing_m;
  service::Elastography elastography(service::Device::open());
  elastography.warm();
  const std::size_t seeds = options.quick ? std::min<std::size_t>(1, options.seeds) : options.seeds;
  std::vector<Estimator> all = estimators();
  if (options.promised) std::erase_if(all, [](const Estimator& e) { return !e.promised; });
  std::map<Truth, std::vector<RealResult>> held_to;
  std::vector<RealRow> rows = patient_rows();
  std::ranges::move(independent_rows(), std::back_inserter(rows));
  print_head();
  for (const RealRow& row : rows) {
    const bool patient = row.truth == Truth::kPatient;
    if ((options.quick && !row.quick) || row.name.find(options.only) == std::string::npos) continue;
    for (std::size_t k = 0; k < (patient ? seeds : std::min(seeds, kMinSeeds)); ++k) {
      const std::uint64_t seed = options.first_seed + k;
      const Window w = row.window(seed, options.spacing_m);
      if (!options.keep.empty())
        keep(w, std::filesystem::path(options.keep) /
                    fmt::format("{}_contrast_{}_seed_{}", snake_case(row.name), row.contrast, seed));
      show_progress(fmt::format("{}, contrast {}: seed {}, {} of {}, solved in {:.1f} s", row.name,
                                row.contrast, seed, k + 1, seeds, w.truth_s));
      for (const Estimator& by : all) figures.windows.push_back(estimated(elastography, row, seed, w, by));
    }
    for (const Estimator& by : all) {
      std::vector<RealWindow> of;
      std::ranges::copy_if(figures.windows, std::back_inserter(of), [&](const RealWindow& w) {
        return w.row == row.name && w.contrast_of_lump == row.contrast && w.estimator == by.name;
      });
      if (of.empty()) continue;
      figures.rows.push_back(summary(of));
      print(figures.rows.back());
      if (!by.promised) continue;
      held_to[row.truth].push_back(figures.rows.back());
      if (row.contrast > 3) continue;
      (!patient            ? figures.independent
       : row.contrast == 1 ? figures.without_lump
                           : figures.lump_of_3)
          .push_back(line_of(figures.rows.back()));
    }
  }
  const auto all_have = [](const std::vector<RealResult>& of, std::size_t least) {
    return std::ranges::all_of(of, [least](const RealResult& r) { return r.seeds >= least; });
  };
  const std::vector<RealResult>&patients = held_to[Truth::kPatient], &wide = held_to[Truth::kIndependent],
        &beside = held_to[Truth::kIndependentBeside];
  if (all_have(patients, kMinPatientSeeds)) promise(patients, promises);
  if (all_have(wide, kMinIndependentSeeds) && all_have(beside, kMinIndependentSeeds))
    promise_independent(wide, beside, promises);
  if (const std::vector<RealResult>& wrong = held_to[Truth::kStatedWrongly];
      !wrong.empty() && all_have(wrong, kMinSeeds))
    promise_of_wrong_statements(wrong, figures.windows, promises);
  double under_pad = kNan;
  for (const RealResult& r : held_to[Truth::kUnderPad])
    if (r.seeds >= kMinIndependentSeeds) under_pad = std::fmax(under_pad, std::abs(r.background - 1));
  if (!std::isnan(under_pad))
    promises.push_back({"background_under_a_pad_known_to_5_percent_off_by", under_pad, 0.08});
  return figures;
}

}  // namespace

void add_real_tissue_suite(CLI::App& app, bool& met) {
  const auto options = std::make_shared<RealOptions>();
  CLI::App& suite = add_suite(app, "real-tissue", "the modulus of solids unlike what the estimator assumes",
                              options, met, measure, [](const RealFigures&, const std::filesystem::path&) {});
  suite.add_option("--seeds", options->seeds, "of each row")->check(CLI::Range(0, 1000));
  suite.add_option("--first-seed", options->first_seed, "the others follow it");
  suite.add_option("--windows-of", options->windows_of,
                   "the --json of earlier runs, whose windows are taken as well; with --seeds 0 alone");
  suite.add_option("--truth-spacing-m", options->spacing_m, "of the truth's nodes along the probe")
      ->check(CLI::Range(0.0005, 0.004));
  suite.add_option("--only", options->only, "rows whose name has this");
  suite.add_option("--keep", options->keep, "a folder for the RF pairs and their forces (MetaImage, JSON)");
  suite.add_flag("--promised", options->promised, "no estimators beside the one that is promised");
}

}  // namespace teletact::bench
