// teletact-client: everything that runs beside a person or a patient.
#include <cstdio>
#include <exception>

#include "client/commands.h"

int main(int argc, char** argv) {
  using namespace teletact::client;
  CLI::App app("teletact-client: the patient side and the operator side of teletact", "teletact-client");
  app.require_subcommand(1);
  add_acquire_command(app);
  add_estimate_command(app);
  add_experiment_command(app);
  add_patient_command(app);
  add_replay_command(app);
  add_report_command(app);
  add_touch_command(app);
  try {
    app.parse(argc, argv);
  } catch (const CLI::ParseError& error) {
    return app.exit(error);
  } catch (const std::exception& error) {
    std::fprintf(stderr, "teletact-client: %s\n", error.what());
    return 1;
  }
  return 0;
}
