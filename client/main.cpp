// teletact-client: everything that runs beside a person or a patient.
#include <grpc/support/log.h>

#include <cstdio>
#include <exception>

#include "client/commands/commands.h"

int main(int argc, char** argv) {
  using namespace teletact::client;
  // What gRPC says of each refused call, we say once, in words.
  gpr_set_log_function([](gpr_log_func_args*) {});
  CLI::App app("teletact-client: the patient side and the operator side of teletact", "teletact-client");
  app.set_version_flag("--version", "teletact-client " TELETACT_VERSION);
  app.require_subcommand(1);
  app.failure_message(usage_message);
  add_commands(app);
  try {
    app.parse(argc, argv);
  } catch (const CLI::ParseError& error) {
    return app.exit(error) == 0 ? 0 : 2;
  } catch (const UsageError& error) {
    std::fprintf(stderr, "teletact-client: %s\n", error.what());
    return 2;
  } catch (const std::exception& error) {
    std::fprintf(stderr, "teletact-client: %s\n", error.what());
    return 1;
  }
  return 0;
}
