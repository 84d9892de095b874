// Runs a suite and keeps its figures.
//
// A suite checks its answers before it times, computes structs of raw figures, and draws from those alone, so
// that an earlier run can be drawn again from its JSON (--replot). A struct says once what it is called in
// JSON, by NLOHMANN_DEFINE_TYPE_NON_INTRUSIVE in the file that runs the suite; NaN and infinity are null
// there.
#pragma once

#include <filesystem>
#include <functional>
#include <memory>
#include <nlohmann/json.hpp>
#include <string>
#include <utility>
#include <vector>

#include "bench/suite.h"

namespace teletact::bench {

NLOHMANN_DEFINE_TYPE_NON_INTRUSIVE(Quantiles, count, min, p50, p95, p99, max)

// The subcommand `name` with --json, --out, --quick, --force and --replot, for options of its own to be added
// to; it sets `met` to what `run` returns. What cannot be written, parsing throws as BenchError. `options`
// must outlive the parsing.
CLI::App& add_suite(CLI::App& app, const char* name, const char* about, SuiteOptions& options, bool& met,
                    std::function<bool()> run);

// Date, version of teletact, processor, cores, memory, kernel, compiler.
nlohmann::json machine();

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

}  // namespace teletact::bench
