// teletact-bench SUITE: measures, checks its answers first, and says whether the promises are met.
#include <CLI/CLI.hpp>
#include <cstdio>
#include <exception>

#include "bench/suite.h"

int main(int argc, char** argv) {
  CLI::App app("teletact-bench: measurements against promises; exit code 1 when one is not met",
               "teletact-bench");
  app.set_version_flag("--version", "teletact-bench " TELETACT_VERSION);
  app.require_subcommand(1);
  app.option_defaults()->always_capture_default();
  app.failure_message([](const CLI::App* all, const CLI::Error& error) {
    const auto unknown = all->remaining();
    return all->get_subcommands().empty() && !unknown.empty()
               ? "no suite '" + unknown.front() + "'; --help lists them\n"
               : CLI::FailureMessage::simple(all, error);
  });
  bool met = true;
  teletact::bench::add_paper_suite(app, met);
  teletact::bench::add_servo_suite(app, met);
  teletact::bench::add_throughput_suite(app, met);
  teletact::bench::add_load_suite(app, met);
  teletact::bench::add_load_worker(app);
  teletact::bench::add_soak_suite(app, met);
  teletact::bench::add_contact_suite(app, met);
  teletact::bench::add_device_suite(app, met);
  teletact::bench::add_stability_suite(app, met);
  teletact::bench::add_exploration_suite(app, met);
  teletact::bench::add_law_suite(app, met);
  teletact::bench::add_link_suite(app, met);
  teletact::bench::add_elastography_suite(app, met);
  teletact::bench::add_posterior_suite(app, met);
  teletact::bench::add_solid_suite(app, met);
  teletact::bench::add_patients_suite(app, met);
  teletact::bench::add_plan_suite(app, met);
  teletact::bench::add_real_tissue_suite(app, met);
  teletact::bench::add_warnings_suite(app, met);
  teletact::bench::add_report_command(app);
  try {
    app.parse(argc, argv);
  } catch (const CLI::ParseError& error) {
    return app.exit(error) == 0 ? 0 : 2;
  } catch (const std::exception& error) {
    std::fprintf(stderr, "teletact-bench: %s\n", error.what());
    return 1;
  }
  return met ? 0 : 1;
}
