// teletact-bench warnings: how often each warning of an estimate fires where it is provoked, at a stated
// level, and where it is not.
#include <fmt/format.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <cmath>
#include <iterator>
#include <map>
#include <memory>
#include <set>
#include <stdexcept>
#include <string_view>
#include <utility>

#include "bench/basics/median.h"
#include "bench/run_suite.h"
#include "bench/suites/warnings/cases.h"
#include "service/imaging/estimate.h"
#include "service/imaging/modulus/judge.h"

namespace teletact::bench {
namespace {

constexpr std::size_t kMinCases = 20;  // of a row, for a share to mean anything
constexpr double kFires = 0.9, kStaysQuiet = 0.05;

struct WarningOptions : SuiteOptions {
  std::size_t cases = 60;
  std::uint64_t first_seed = 1;
  std::vector<std::string> cases_of;  // --json of earlier runs
  std::string only;
};

struct WarningResult {
  std::string warning, name;
  bool provoked = false;
  std::size_t cases = 0, fired = 0, refused = 0;
  double background = 0, stated = 0;  // medians: over the truth; deviation of ln E
};
NLOHMANN_DEFINE_TYPE_NON_INTRUSIVE(WarningResult, warning, name, provoked, cases, fired, refused, background,
                                   stated)
// One of a row's windows, estimated once for all that is claimed of it.
struct JudgedCase {
  std::string name;
  std::uint64_t seed = 0;
  bool refused = false;
  std::vector<std::string> fired = {}, misquoted = {};  // those whose number is not the map's
  std::string failed = {};                              // why it has no estimate, where the push is enough
  double background = kNan, stated = kNan;
};
NLOHMANN_DEFINE_TYPE_NON_INTRUSIVE(JudgedCase, name, seed, refused, fired, misquoted, failed, background,
                                   stated)
struct WarningFigures {
  std::vector<WarningResult> rows;
  std::vector<JudgedCase> cases;
  std::size_t cases_of_each_row = 0;  // at least
};
NLOHMANN_DEFINE_TYPE_NON_INTRUSIVE_WITH_DEFAULT(WarningFigures, rows, cases, cases_of_each_row)

// The part of an estimate that comes after tracking.
class AfterTracking {
 public:
  AfterTracking() : AfterTracking(service::Device::open()) {}
  explicit AfterTracking(const std::shared_ptr<service::Device>& device)
      : whole_(device),
        queue_(device->queue()),
        strips_(std::make_shared<service::StripCache>()),
        solid_(service::make_solid(queue_, {}, strips_)),
        iterative_(service::make_iterative(queue_, strips_)),
        direct_(service::make_direct(queue_, {}, strips_)) {}
  const service::Queue& queue() const { return queue_; }
  service::ModulusEstimate operator()(const WarnedWindow& w, std::uint64_t seed) {
    const service::Measured measured =
        w.plane ? w.plane->input().measured : measured_of(queue_, w.displacement, seed);
    const service::ModulusInput input{measured, w.width_m, w.tissue, w.force, w.known, w.budget};
    service::ModulusMethod& method = w.kind == service::ModulusKind::kSolid       ? *solid_
                                     : w.kind == service::ModulusKind::kIterative ? *iterative_
                                                                                  : *direct_;
    service::ModulusEstimate out = method.estimate(input);
    service::judge(input, *strips_, out);
    return out;
  }
  // Names of the warnings of frames, or of what a refusal says to be its cause.
  std::vector<std::string> said_of(const StatedFrames& frames) {
    std::vector<std::string> names;
    try {
      const double width_m = static_cast<double>(frames.pre.line_count) * frames.geometry.line_pitch_m,
                   depth_m = static_cast<double>(frames.pre.sample_count) * frames.geometry.sample_pitch_m();
      const service::Estimate e =
          whole_.estimate(frames.pre, frames.post,
                          {.geometry = frames.geometry,
                           .force = std::nullopt,
                           .tissue = {width_m, depth_m, 0, 0.49},
                           .modulus = {.kind = service::ModulusKind::kReferenceStress}});
      for (const service::Warning& warning : e.input_warnings) names.emplace_back(name_of(warning.flag));
    } catch (const service::TrackingError& refusal) {
      constexpr std::string_view kCause = "but first: ";
      const std::string_view text = refusal.what();
      if (const std::size_t at = text.find(kCause); at != std::string_view::npos)
        names.emplace_back(service::flag_of(text.substr(at + kCause.size())));
    }
    return names;
  }

 private:
  service::Elastography whole_;
  service::Queue queue_;
  std::shared_ptr<service::StripCache> strips_;
  std::unique_ptr<service::ModulusMethod> solid_, iterative_, direct_;
};

double median_said(const service::Field& field) {
  std::vector<double> said;
  for (const float v : field)
    if (std::isfinite(v)) said.push_back(v);
  return median_of(said);
}

constexpr const char* kLine = "{:<14} {:<60} {:>9} {:>7} {:>11} {:>7}\n";

void print(const WarningResult& r) {
  fmt::print(kLine, r.warning, r.name + (r.provoked ? "" : " (not provoked)"),
             fmt::format("{}/{}", r.fired, r.cases), r.refused, fmt::format("{:.2f}", r.background),
             fmt::format("{:.2f}", r.stated));
}

// Whether a warning that says how uncertain the map is says another number than the map's median.
bool misquotes(const std::string& text, double stated) {
  constexpr std::string_view kSays = "uncertain by ";
  const std::size_t at = text.find(kSays);
  double number = 0;
  if (at == std::string::npos) return false;
  const char* const said = text.c_str() + at + kSays.size();
  if (std::sscanf(said, "a factor of %lf", &number) == 1) return std::abs(std::log(number) - stated) > 0.05;
  return std::sscanf(said, "%lf %%", &number) != 1 || std::abs(number / 100 - stated) > 0.01;
}

JudgedCase judged(AfterTracking& estimate, const WarnedWindow& w, const std::string& name,
                  std::uint64_t seed) {
  JudgedCase out{.name = name, .seed = seed};
  if (w.frames) {
    out.fired = estimate.said_of(*w.frames);
    return out;
  }
  try {
    const service::ModulusEstimate e = estimate(w, seed);
    out.background = e.background / w.background_pa, out.stated = median_said(e.log_deviation);
    for (const service::Warning& warning : e.warnings) {
      out.fired.emplace_back(service::name_of(warning.flag));
      if (misquotes(warning.text, out.stated)) out.misquoted.push_back(out.fired.back());
    }
  } catch (const service::NoCompression&) {
    out.refused = true;
  } catch (const std::invalid_argument& failure) {
    out.failed = failure.what();
    fmt::print("{}, seed {}: {}\n", name, seed, out.failed);
  }
  return out;
}

std::vector<double> told(const std::vector<JudgedCase>& all, double JudgedCase::*member) {
  std::vector<double> values;
  for (const JudgedCase& j : all)
    if (!j.refused && j.failed.empty()) values.push_back(j.*member);
  return values;
}

WarningResult result_of(const WarningRow& row, const Claim& claim, const std::vector<JudgedCase>& all) {
  WarningResult r{.warning = claim.warning, .name = row.name, .provoked = claim.provoked};
  r.cases = all.size();
  for (const JudgedCase& j : all) {
    r.refused += j.refused;
    r.fired += std::ranges::count(j.fired, claim.warning) > 0;
  }
  r.background = median_of(told(all, &JudgedCase::background)),
  r.stated = median_of(told(all, &JudgedCase::stated));
  return r;
}

// What fired that nothing is claimed of.
void print_others(const WarningRow& row, const std::vector<JudgedCase>& all) {
  std::map<std::string, std::size_t> others;
  for (const JudgedCase& j : all)
    for (const std::string& fired : std::set<std::string>(j.fired.begin(), j.fired.end()))
      if (std::ranges::none_of(row.claims, [&](const Claim& c) { return c.warning == fired; }))
        ++others[fired];
  for (const auto& [other, count] : others) fmt::print("{:>20} as well: {}\n", other, count);
  std::fflush(stdout);
}

bool wanted(const WarningRow& row, const std::string& word) {
  return row.name.find(word) != std::string::npos || std::ranges::any_of(row.claims, [&](const Claim& c) {
           return c.warning.find(word) != std::string::npos;
         });
}

// Those of earlier runs. Throws BenchError for a case that is there twice.
std::vector<JudgedCase> earlier_cases(const WarningOptions& options) {
  std::vector<JudgedCase> all;
  std::set<std::pair<std::string, std::uint64_t>> known;
  for (const std::string& file : options.cases_of) {
    SuiteOptions earlier = options;
    earlier.replot = file, earlier.out = ".";  // nothing is drawn there
    for (JudgedCase& j : earlier_figures("warnings", earlier).get<WarningFigures>().cases) {
      if (!known.emplace(j.name, j.seed).second)
        throw BenchError(fmt::format("--cases-of {}: seed {} of \"{}\" is in another of the files, too", file,
                                     j.seed, j.name));
      all.push_back(std::move(j));
    }
  }
  return all;
}

WarningFigures measure(const WarningOptions& options, Promises& promises) {
  WarningFigures figures;
  figures.cases = earlier_cases(options);
  AfterTracking estimate;
  const std::size_t cases = options.quick ? std::min<std::size_t>(2, options.cases) : options.cases;
  fmt::print(kLine, "warning", "level", "fired", "refused", "background", "stated");
  for (const WarningRow& row : warning_rows(estimate.queue())) {
    if (!wanted(row, options.only)) continue;
    for (std::size_t k = 0; k < cases; ++k) {
      const std::uint64_t seed = options.first_seed + k;
      show_progress(fmt::format("{}: {} of {}", row.name, k + 1, cases));
      figures.cases.push_back(judged(estimate, row.window(seed), row.name, seed));
    }
    std::vector<JudgedCase> all;
    std::ranges::copy_if(figures.cases, std::back_inserter(all),
                         [&](const JudgedCase& j) { return j.name == row.name; });
    if (all.empty()) continue;
    for (const Claim& claim : row.claims) {
      figures.rows.push_back(result_of(row, claim, all));
      print(figures.rows.back());
    }
    print_others(row, all);
  }
  if (!figures.rows.empty())
    figures.cases_of_each_row = std::ranges::min(figures.rows, {}, &WarningResult::cases).cases;
  std::size_t misquoted = 0, failed = 0;
  for (const JudgedCase& j : figures.cases) misquoted += !j.misquoted.empty(), failed += !j.failed.empty();
  promises.push_back({"estimates_that_failed", static_cast<double>(failed), 0});
  promises.push_back({"numbers_that_are_not_the_maps", static_cast<double>(misquoted), 0});
  for (const WarningResult& r : figures.rows) {
    if (r.cases < kMinCases) continue;
    // A refused window has no map that a warning could be of.
    const double fired =
        static_cast<double>(r.fired) / static_cast<double>(std::max<std::size_t>(1, r.cases - r.refused));
    const std::string name = snake_case(r.warning + " " + r.name);
    if (r.provoked)
      promises.push_back({name, fired, kFires, "", false});
    else
      promises.push_back({name, fired, kStaysQuiet});
  }
  return figures;
}

}  // namespace

void add_warnings_suite(CLI::App& app, bool& met) {
  const auto options = std::make_shared<WarningOptions>();
  CLI::App& suite = add_suite(
      app, "warnings", "how often warnings of an estimate fire where they are provoked, and where not",
      options, met, measure, [](const WarningFigures&, const std::filesystem::path&) {});
  suite.add_option("--cases", options->cases, "of each row")->check(CLI::Range(0, 1000));
  suite.add_option("--first-seed", options->first_seed, "the others follow it");
  suite.add_option("--cases-of", options->cases_of,
                   "the --json of earlier runs, whose cases are taken as well; with --cases 0 alone");
  suite.add_option("--only", options->only, "rows whose level or warning has this");
}

}  // namespace teletact::bench
