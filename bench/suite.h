// What every part of a bench suite shares: options, promises, quantiles. Running one is run_suite.h.
#pragma once

#include <stdexcept>
#include <string>
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

// How far a long run is: one line of a terminal, written over again; nothing where nobody looks at one.
void show_progress(const std::string& line);

struct Quantiles {
  std::size_t count = 0;
  double min = 0, p50 = 0, p95 = 0, p99 = 0, max = 0;
};
// Throws BenchError when there are none.
Quantiles quantiles(std::vector<double> seconds);

// Suites; each adds its subcommand and sets `met` when it has run.
void add_paper_suite(CLI::App& app, bool& met);
void add_servo_suite(CLI::App& app, bool& met);
void add_throughput_suite(CLI::App& app, bool& met);
void add_load_suite(CLI::App& app, bool& met);
void add_soak_suite(CLI::App& app, bool& met);
void add_contact_suite(CLI::App& app, bool& met);
void add_stability_suite(CLI::App& app, bool& met);
void add_device_suite(CLI::App& app, bool& met);
void add_elastography_suite(CLI::App& app, bool& met);
void add_exploration_suite(CLI::App& app, bool& met);
void add_law_suite(CLI::App& app, bool& met);
void add_link_suite(CLI::App& app, bool& met);
void add_posterior_suite(CLI::App& app, bool& met);
void add_solid_suite(CLI::App& app, bool& met);
void add_patients_suite(CLI::App& app, bool& met);
void add_plan_suite(CLI::App& app, bool& met);
void add_real_tissue_suite(CLI::App& app, bool& met);
void add_warnings_suite(CLI::App& app, bool& met);

// One of the processes of the suite `load`, which starts them.
void add_load_worker(CLI::App& app);

// Pages for people from the --json of suites.
void add_report_command(CLI::App& app);

}  // namespace teletact::bench
