// What every bench suite shares: its options, the promised figures, the machine, and its JSON.
//
// A suite checks its answers before it times, keeps raw figures in its JSON, and replots from that JSON
// without running again (--replot).
#pragma once

#include <CLI/CLI.hpp>
#include <filesystem>
#include <nlohmann/json.hpp>
#include <stdexcept>
#include <string>
#include <vector>

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

// One figure that the project promises; the exit code is 1 when one is not met.
struct Target {
  std::string name;
  double value = 0, target = 0;
  std::string unit;
  bool at_most = true;
  bool met() const { return at_most ? value <= target : value >= target; }  // false for NaN
};

// Adds --json, --out, --quick, --force and --replot; what cannot be written, parsing throws as BenchError.
void add_common_options(CLI::App& command, SuiteOptions& options);

// Date, version of teletact, processor, cores, memory, kernel, compiler.
nlohmann::json machine();

// How far a long run is: one line of a terminal, written over again; nothing where nobody looks at one.
void show_progress(const std::string& line);

// {count, p50, p95, p99, max} of seconds; throws BenchError when there are none.
nlohmann::json quantiles(std::vector<double> seconds);

// Adds machine, whether it was quick, targets and their state, writes --json, prints the targets. Returns
// whether all were met.
bool finish(nlohmann::json& result, const std::vector<Target>& targets, const SuiteOptions& options);

// With --replot: draws the pictures of an earlier run of that suite into --out, from its JSON alone, and
// returns true; without, returns false. Throws BenchError for a file that is no JSON of this suite.
bool replotted(const SuiteOptions& options, const std::string& suite,
               void (*draw)(const nlohmann::json& result, const std::string& folder));

// Runs gnuplot on `script`, writing `file`. Throws BenchError.
void plot(const std::filesystem::path& file, const std::string& script);

// Suites; each adds its subcommand and sets `met` when it has run.
void add_paper_suite(CLI::App& app, bool& met);
void add_servo_suite(CLI::App& app, bool& met);
void add_throughput_suite(CLI::App& app, bool& met);
void add_soak_suite(CLI::App& app, bool& met);
void add_contact_suite(CLI::App& app, bool& met);
void add_stability_suite(CLI::App& app, bool& met);
void add_elastography_suite(CLI::App& app, bool& met);
void add_exploration_suite(CLI::App& app, bool& met);

}  // namespace teletact::bench
