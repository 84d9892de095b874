// teletact-client: everything that runs beside a person or a patient.
#include <cmath>
#include <cstdio>
#include <exception>

#include "client/commands.h"
#include "client/link/channel.h"

namespace teletact::client {

namespace {

CLI::Validator number_check(const char* allowed, bool zero) {
  return CLI::Validator(
      [allowed, zero](std::string& text) -> std::string {
        double value = 0;
        const bool good = CLI::detail::lexical_cast(text, value) && std::isfinite(value) && value >= 0;
        return good && (zero || value > 0) ? ""
                                           : "must be a number " + std::string(allowed) + ", not " + text;
      },
      allowed);
}

// CLI11 reads "nan" and "inf" as numbers, and its ranges let nan through. For every option of every command,
// after its own checks.
void refuse_what_is_not_finite(CLI::App& app) {
  const auto problem = [](const std::string& text) {
    double value = 0;
    const bool good = !CLI::detail::lexical_cast(text, value) || std::isfinite(value);
    return good ? "" : "must be a finite number, not " + text;
  };
  for (CLI::App* command : app.get_subcommands({}))
    for (CLI::Option* option : command->get_options())
      if (option->get_type_name().rfind("FLOAT", 0) == 0) option->check(problem);
}

}  // namespace

CLI::Validator zero_or_more() {
  return number_check("of 0 or more", true);
}

CLI::Validator above_zero() {
  return number_check("above 0", false);
}

std::string with_flags(std::string message, const std::vector<std::pair<std::string, std::string>>& flags) {
  for (const auto& [field, flag] : flags) {
    const std::size_t at = message.find(field + ":");
    if (at == std::string::npos || (at > 0 && message[at - 1] != ' ')) continue;
    message.replace(at, field.size(), flag);
    break;
  }
  return message;
}

void say(const std::string& line) {
  std::fprintf(stderr, "%s\n", line.c_str());
}

void add_service_options(CLI::App& command, std::string& address, std::string& tls_ca) {
  command.add_option("--service", address, "HOST:PORT or unix:/path")->required()->check(address_problem);
  command.add_option_function<std::string>(
      "--tls-ca", [&tls_ca](const std::string& path) { tls_ca = read_tls_ca(path); },
      "PEM certificate that signed the service's; without it nothing is encrypted");
}

}  // namespace teletact::client

int main(int argc, char** argv) {
  using namespace teletact::client;
  CLI::App app("teletact-client: the patient side and the operator side of teletact", "teletact-client");
  app.set_version_flag("--version", "teletact-client " TELETACT_VERSION);
  app.require_subcommand(1);
  app.failure_message([](const CLI::App* all, const CLI::Error& error) {
    const auto unknown = all->remaining();
    return all->get_subcommands().empty() && !unknown.empty()
               ? "no command '" + unknown.front() + "'; --help lists them\n"
               : CLI::FailureMessage::simple(all, error);
  });
  add_acquire_command(app);
  add_estimate_command(app);
  add_experiment_command(app);
  add_patient_command(app);
  add_replay_command(app);
  add_report_command(app);
  add_scenes_command(app);
  add_touch_command(app);
  refuse_what_is_not_finite(app);
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
