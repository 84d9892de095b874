// What every bench suite shares: its options, the promised figures, the machine, and its JSON.
//
// A suite checks its answers before it times, computes structs of raw figures, and draws from those alone, so
// that an earlier run can be drawn again from its JSON (--replot). A struct says once what it is called in
// JSON, by NLOHMANN_DEFINE_TYPE_NON_INTRUSIVE; NaN and infinity are null there.
#pragma once

#include <filesystem>
#include <functional>
#include <memory>
#include <nlohmann/json.hpp>
#include <stdexcept>
#include <string>
#include <utility>
#include <vector>

#include "client/report/promise.h"

namespace CLI {
class App;
}

namespace teletact::bench {

// One line for the user.
struct BenchError : std::runtime_error {
  using std::runtime_error::runtime_error;
};

struct SuiteOptions {
  std::string json;  // write the result here
  std::string out;   // folder for pictures
  bool quick = false;
  bool force = false;  // a result that is there may be written over
  std::string replot;  // JSON of an earlier run: draw its pictures again, measure nothing
};

// The exit code is 1 when one is not met. Their names are snake_case words.
using Promises = std::vector<client::Promise>;

// "layer 80 mm, 0.49" -> "layer_80_mm_0_49"
std::string snake_case(const std::string& text);

// The subcommand `name` with --json, --out, --quick, --force and --replot, for options of its own to be added
// to; it sets `met` to what `run` returns. What cannot be written, parsing throws as BenchError. `options`
// must outlive the parsing.
CLI::App& add_suite(CLI::App& app, const char* name, const char* about, SuiteOptions& options, bool& met,
                    std::function<bool()> run);

// Date, version of teletact, processor, cores, memory, kernel, compiler.
nlohmann::json machine();

// How far a long run is: one line of a terminal, written over again; nothing where nobody looks at one.
void show_progress(const std::string& line);

struct Quantiles {
  std::size_t count = 0;
  double min = 0, p50 = 0, p95 = 0, p99 = 0, max = 0;
};
NLOHMANN_DEFINE_TYPE_NON_INTRUSIVE(Quantiles, count, min, p50, p95, p99, max)
// Throws BenchError when there are none.
Quantiles quantiles(std::vector<double> seconds);

// Adds the suite's name, machine, whether it was quick, promises and their state, writes --json, prints the
// promises. Returns whether all were met.
bool finish(const std::string& suite, nlohmann::json figures, const Promises&, const SuiteOptions&);

// --replot. Throws BenchError for a file that is no JSON of this suite.
nlohmann::json earlier_figures(const std::string& suite, const SuiteOptions&);
[[noreturn]] void throw_foreign(const std::string& suite, const SuiteOptions&);

// Figures measure(Promises&), which adds what it promises, and draw(figures, folder), which is also what
// --replot does. Returns whether all promises were met.
template <class Measure, class Draw>
bool run_suite(const std::string& suite, const SuiteOptions& options, Measure&& measure, Draw&& draw) {
  using Figures = decltype(measure(std::declval<Promises&>()));
  if (!options.replot.empty()) {
    try {
      draw(earlier_figures(suite, options).template get<Figures>(), std::filesystem::path(options.out));
    } catch (const nlohmann::json::exception&) {
      throw_foreign(suite, options);  // of another version, or changed by hand
    }
    return true;
  }
  Promises promises;
  const Figures figures = measure(promises);
  const bool met = finish(suite, figures, promises, options);
  if (!options.out.empty()) draw(figures, std::filesystem::path(options.out));
  return met;
}

// add_suite() of one that runs run_suite(): figures measure(const Options&, Promises&), draw(figures,
// folder).
template <class Options, class Measure, class Draw>
CLI::App& add_suite(CLI::App& app, const char* name, const char* about,
                    const std::shared_ptr<Options>& options, bool& met, Measure measure, Draw draw) {
  return add_suite(app, name, about, *options, met, [=] {
    return run_suite(
        name, *options, [&](Promises& promises) { return measure(*options, promises); }, draw);
  });
}

// An experiment of a suite that has several, each with figures, promises and pictures of its own.
struct Part {
  const char* name;
  std::function<nlohmann::json(bool quick, Promises&)> measure;
  std::function<void(const nlohmann::json& figures, const std::filesystem::path& folder)> draw;
};
template <class Figures>
Part make_part(const char* name, Figures (*measure)(bool, Promises&),
               void (*draw)(const Figures&, const std::filesystem::path&) = nullptr) {
  return {name, measure, [draw](const nlohmann::json& figures, const std::filesystem::path& folder) {
            if (draw != nullptr) draw(figures.get<Figures>(), folder);
          }};
}
// add_suite() of one with several experiments: the user names one of `parts`, or "all"; `experiments` says
// what each is.
void add_suite(CLI::App& app, const char* name, const char* about, const char* experiments,
               std::vector<Part> parts, bool& met);

// Suites; each adds its subcommand and sets `met` when it has run.
void add_paper_suite(CLI::App& app, bool& met);
void add_servo_suite(CLI::App& app, bool& met);
void add_throughput_suite(CLI::App& app, bool& met);
void add_load_suite(CLI::App& app, bool& met);
void add_soak_suite(CLI::App& app, bool& met);
void add_contact_suite(CLI::App& app, bool& met);
void add_stability_suite(CLI::App& app, bool& met);
void add_elastography_suite(CLI::App& app, bool& met);
void add_exploration_suite(CLI::App& app, bool& met);
void add_law_suite(CLI::App& app, bool& met);
void add_link_suite(CLI::App& app, bool& met);
void add_posterior_suite(CLI::App& app, bool& met);
void add_solid_suite(CLI::App& app, bool& met);
void add_plan_suite(CLI::App& app, bool& met);
void add_real_tissue_suite(CLI::App& app, bool& met);
void add_warnings_suite(CLI::App& app, bool& met);

// A touch of the simulated solid patient beside that patient's own tissue. Its exit code is 2 where what is
// promised is not met.
void add_solid_felt_command(CLI::App& app);

// One of the processes of the suite `load`, which starts them.
void add_load_worker(CLI::App& app);

// Pages for people from the --json of suites.
void add_report_command(CLI::App& app);

}  // namespace teletact::bench
