// teletact-bench warnings: how often each warning of an estimate fires where it is provoked, at a stated
// level, and where it is not.
#include <fmt/format.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <cmath>
#include <map>
#include <memory>

#include "bench/basics/clock.h"
#include "bench/basics/median.h"
#include "bench/suite.h"
#include "bench/suites/warnings/cases.h"
#include "service/imaging/modulus/judge.h"

namespace teletact::bench {
namespace {

constexpr std::size_t kLeastCases = 20;  // of a row, for a share to mean anything
constexpr double kFires = 0.9, kStaysQuiet = 0.05;

struct WarningOptions : SuiteOptions {
  std::size_t cases = 60;
  std::string only;
};

struct WarningResult {
  std::string warning, name;
  bool provoked = false;
  std::size_t cases = 0, fired = 0, refused = 0;
  double background = 0, stated = 0;  // medians: over the truth; deviation of ln E
  double seconds = 0;
  std::map<std::string, std::size_t> others = {};  // warnings that fired as well
};
NLOHMANN_DEFINE_TYPE_NON_INTRUSIVE(WarningResult, warning, name, provoked, cases, fired, refused, background,
                                   stated, seconds, others)
struct WarningFigures {
  std::vector<WarningResult> rows;
};
NLOHMANN_DEFINE_TYPE_NON_INTRUSIVE(WarningFigures, rows)

// The part of an estimate that comes after tracking.
class AfterTracking {
 public:
  AfterTracking()
      : queue_(service::Device::open()->queue()),
        strips_(std::make_shared<service::StripCache>()),
        solid_(service::make_solid(queue_, {}, strips_)),
        iterative_(service::make_iterative(queue_, {}, {}, strips_)),
        direct_(service::make_direct(queue_, {}, strips_)),
        judge_(strips_, {}, service::DirectOptions{}.reach) {}
  const service::Queue& queue() const { return queue_; }
  service::ModulusEstimate operator()(const WarnedWindow& w, std::uint64_t seed) {
    const service::Measured measured =
        w.plane ? w.plane->input().measured : measured_of(queue_, w.displacement, seed);
    const service::ModulusInput input{measured, DrawnWindow::kWindowM, w.tissue, w.force,
                                      w.known,  w.seconds_left};
    service::ModulusMethod& method = w.kind == service::ModulusKind::kSolid       ? *solid_
                                     : w.kind == service::ModulusKind::kIterative ? *iterative_
                                                                                  : *direct_;
    service::ModulusEstimate out = method.estimate(input);
    judge_.judge(input, out);
    return out;
  }

 private:
  service::Queue queue_;
  std::shared_ptr<service::StripCache> strips_;
  std::unique_ptr<service::ModulusMethod> solid_, iterative_, direct_;
  service::ModulusJudge judge_;
};

double median_said(const service::Field& field) {
  std::vector<double> said;
  for (const float v : field)
    if (std::isfinite(v)) said.push_back(v);
  return median_of(said);
}

constexpr const char* kLine = "{:<14} {:<60} {:>9} {:>7} {:>11} {:>7} {:>5}\n";

void print(const WarningResult& r) {
  fmt::print(kLine, r.warning, r.name + (r.provoked ? "" : " (not provoked)"),
             fmt::format("{}/{}", r.fired, r.cases), r.refused, fmt::format("{:.2f}", r.background),
             fmt::format("{:.2f}", r.stated), fmt::format("{:.1f}", r.seconds));
  for (const auto& [other, count] : r.others) fmt::print("{:>20} as well: {}\n", other, count);
  std::fflush(stdout);
}

WarningFigures measure(const WarningOptions& options, Promises& promises) {
  AfterTracking estimate;
  const std::size_t cases = options.quick ? 2 : options.cases;
  WarningFigures figures;
  fmt::print(kLine, "warning", "level", "fired", "refused", "background", "stated", "s");
  for (const WarningRow& row : warning_rows(estimate.queue())) {
    WarningResult r{.warning = service::name_of(row.flag), .name = row.name, .provoked = row.provoked};
    if ((r.warning + " " + row.name).find(options.only) == std::string::npos) continue;
    std::vector<double> backgrounds, stated, seconds;
    for (std::uint64_t seed = 1; seed <= cases; ++seed) {
      show_progress(fmt::format("{}, {}: {} of {}", r.warning, row.name, seed, cases));
      const WarnedWindow w = row.window(seed);
      ++r.cases;
      try {
        service::ModulusEstimate e;
        seconds.push_back(seconds_of([&] { e = estimate(w, seed); }));
        r.fired +=
            std::any_of(e.warnings.begin(), e.warnings.end(),
                        [&](const service::ModulusWarning& warning) { return warning.flag == row.flag; });
        backgrounds.push_back(e.background / w.background_pa);
        stated.push_back(median_said(e.log_deviation));
      } catch (const service::NoCompression&) {
        ++r.refused;
      }
    }
    r.background = median_of(backgrounds), r.stated = median_of(stated), r.seconds = median_of(seconds);
    print(r);
    figures.rows.push_back(r);
  }
  if (cases < kLeastCases) return figures;
  for (const WarningResult& r : figures.rows) {
    const double share = static_cast<double>(r.fired + r.refused) / static_cast<double>(r.cases),
                 fired = static_cast<double>(r.fired) / static_cast<double>(r.cases);
    const std::string name = snake_case(r.warning + " " + r.name);
    if (r.provoked)
      promises.push_back({name, share, kFires, "", false});
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
  suite.add_option("--cases", options->cases, "of each row")
      ->check(CLI::Range(1, 1000))
      ->capture_default_str();
  suite.add_option("--only", options->only, "rows whose warning and level have this");
}

}  // namespace teletact::bench
