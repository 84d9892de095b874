#include "client/commands/commands.h"

#include <cmath>
#include <cstdio>
#include <filesystem>

#include "client/link/channel.h"
#include "client/text/utf8.h"

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

template <class Act>
void for_every_option(CLI::App& app, const Act& act) {
  for (CLI::App* command : app.get_subcommands({}))
    for (CLI::Option* option : command->get_options()) act(*option);
}

// CLI11 reads "nan" and "inf" as numbers, and its ranges let nan through.
std::string not_finite(const std::string& text) {
  double value = 0;
  const bool good = !CLI::detail::lexical_cast(text, value) || std::isfinite(value);
  return good ? "" : "must be a finite number, not " + text;
}

// Names end up in messages and in JSON, which take UTF-8 alone and would refuse others after the work is
// done.
std::string not_utf8(const std::string& text) {
  return is_utf8(text) ? ""
                       : "its bytes are not UTF-8; rename it, or go to its folder and leave the path out";
}

// After the option's own checks.
void check_all(CLI::Option& option) {
  if (option.get_type_name().rfind("FLOAT", 0) == 0) option.check(not_finite);
  if (option.get_items_expected_max() > 0) option.check(not_utf8);
}

// What is read from a variable's first value would say 0 where something else is meant.
void hide_default_that_is_none(CLI::Option& option) {
  if (option.get_required() || option.get_description().find("(default:") != std::string::npos)
    option.default_str("");
}

CLI::Option* add_address(CLI::App& command, std::string& address, const std::string& help) {
  return command.add_option("--service", address, help)->check(address_problem);
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

std::vector<CLI::Option*> add_credential_options(CLI::App& command, Credentials& credentials) {
  const std::string usual = command.option_defaults()->get_group();
  command.option_defaults()->group(kLink);
  std::vector<CLI::Option*> added;
  for (const CredentialOption& option : credential_options(credentials))
    added.push_back(command.add_option_function<std::string>(option.flag, option.take, option.description));
  added.push_back(command.add_flag(
      "--proxy", credentials.proxy,
      "connect through the proxy that the environment names (grpc_proxy, https_proxy, http_proxy); without "
      "it none is used"));
  command.option_defaults()->group(usual);
  return added;
}

void add_service_options(CLI::App& command, std::string& address, Credentials& credentials) {
  add_address(command, address, "HOST:PORT or unix:/path")->required();
  add_credential_options(command, credentials);
}

CLI::Option* add_optional_service_options(CLI::App& command, std::string& address, Credentials& credentials,
                                          const std::string& without_it) {
  CLI::Option* const service =
      add_address(command, address, "HOST:PORT or unix:/path; without it " + without_it);
  for (CLI::Option* option : add_credential_options(command, credentials)) option->needs(service);
  return service;
}

void add_force_option(CLI::App& command, bool& force) {
  command.add_flag("--force", force, "overwrite existing files");
}

void require_new_files(const std::vector<NamedFile>& files, bool force) {
  std::error_code ignored;
  for (const NamedFile& file : files)
    if (!file.path.empty() && !force && std::filesystem::is_regular_file(file.path, ignored))
      throw CommandError(file.purpose + " " + file.path +
                         ": it exists; choose another file, or write over it with --force");
}

void refuse_beside(const CLI::App& command, const std::vector<std::string>& options,
                   const std::string& reason) {
  for (const std::string& option : options)
    if (command.count(option) > 0) throw UsageError(option + ": " + reason + "; leave it out");
}

void retire(CLI::App& command, const std::string& option, const std::string& instead) {
  const auto refuse = [=](const std::string&) {
    throw UsageError(option + ": no longer an option; " + instead);
  };
  command.add_option_function<std::string>(option, refuse, "")->group("");
}

std::string usage_message(const CLI::App* app, const CLI::Error& error) {
  const auto unknown = app->remaining(true);
  const auto commands = app->get_subcommands();
  if (commands.empty() && !unknown.empty())
    return "no command '" + unknown.front() + "'; --help lists them\n";
  const std::string help = commands.empty() ? "--help" : commands.front()->get_name() + " --help",
                    kind = error.get_name();
  // It may stand for the one that is missing.
  if (kind == "RequiredError" && !unknown.empty())
    return "no option '" + unknown.front() + "'; " + help + " lists them\n";
  return std::string(error.what()) +
         (kind == "ExcludesError"   ? "; leave one of the two out"
          : kind == "RequiresError" ? "; give both, or neither"
                                    : "; see " + help) +
         "\n";
}

void add_commands(CLI::App& app) {
  app.option_defaults()->always_capture_default();
  add_acquire_command(app);
  add_estimate_command(app);
  add_experiment_command(app);
  add_patient_command(app);
  add_replay_command(app);
  add_report_command(app);
  add_scenes_command(app);
  add_slices_command(app);
  add_touch_command(app);
  add_watch_command(app);
  for_every_option(app, check_all);
  for_every_option(app, hide_default_that_is_none);
}

}  // namespace teletact::client
