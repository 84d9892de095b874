// teletact-client: everything that runs beside a person or a patient.
#include <cstdio>
#include <exception>

#include "client/commands.h"
#include "client/link/channel.h"

namespace teletact::client {

void add_service_options(CLI::App& command, std::string& address, std::string& tls_ca) {
  command.add_option("--service", address, "unix:/path or host:port")->required();
  command.add_option_function<std::string>(
      "--tls-ca", [&tls_ca](const std::string& path) { tls_ca = read_tls_ca(path); },
      "PEM certificate that signed the service's; without it nothing is encrypted");
}

}  // namespace teletact::client

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
  add_scenes_command(app);
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
