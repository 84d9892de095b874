// One function per subcommand of teletact-client; each adds itself to the command line. A command's callback
// throws CommandError with one clear line for the user, or returns.
#pragma once

#include <CLI/CLI.hpp>
#include <stdexcept>
#include <string>
#include <utility>
#include <vector>

#include "client/files/different_files.h"
#include "client/link/credentials.h"

namespace teletact::client {

struct CommandError : std::runtime_error {
  using std::runtime_error::runtime_error;
};

// A mistake on the command line: the process ends with 2.
struct UsageError : CommandError {
  using CommandError::CommandError;
};

// Checks of numbers that say in words what is allowed.
CLI::Validator zero_or_more();
CLI::Validator above_zero();

// A message as it stands, but with the flag for the field that it begins with or names ("radius_m:").
std::string with_flags(std::string message, const std::vector<std::pair<std::string, std::string>>& flags);

// One line on stderr.
void say(const std::string& line);

// --force; see require_new_files().
void add_force_option(CLI::App& command, bool& force);
// Throws CommandError when one of the files exists already, unless `force`. What is no file (/dev/null, a
// pipe) is written to.
void require_new_files(const std::vector<NamedFile>& files, bool force);

// Throws UsageError when one of these options was given, which `reason` makes meaningless. For what depends
// on an option's value; what depends on an option being given is said by its needs() and excludes().
void refuse_beside(const CLI::App& command, const std::vector<std::string>& options,
                   const std::string& reason);

// Refuses an option of a former version, naming what is given in its place.
void retire(CLI::App& command, const std::string& option, const std::string& instead);

// One line for an error that CLI11 found on the command line, with what to do.
std::string usage_message(const CLI::App* app, const CLI::Error& error);

// Option groups that several commands have, as --help shows them. An option in none of a command's groups is
// among its usual ones, which stand first.
inline constexpr const char* kLink = "Link to the service";
inline constexpr const char* kRecording = "Recording";

// What add_service_options() adds but --service: the group kLink.
std::vector<CLI::Option*> add_credential_options(CLI::App& command, Credentials& credentials);
// --service, and the files by which it and this client know each other.
void add_service_options(CLI::App& command, std::string& address, Credentials& credentials);
// The same of a command that needs none; `without_it`: what it does then. Returns --service.
CLI::Option* add_optional_service_options(CLI::App& command, std::string& address, Credentials& credentials,
                                          const std::string& without_it);

// All of the below. Options show their defaults, and take no number that is not finite.
void add_commands(CLI::App& app);

void add_acquire_command(CLI::App& app);     // patient side: arm, frames, upload
void add_estimate_command(CLI::App& app);    // recorded frames -> maps on disk
void add_experiment_command(CLI::App& app);  // psychophysics: method of constant stimuli and its fit
void add_patient_command(CLI::App& app);     // simulated RF pairs with their truth
void add_replay_command(CLI::App& app);      // plays a recording again
void add_report_command(CLI::App& app);      // recordings + truth -> summary.json and pictures
void add_scenes_command(CLI::App& app);      // list the scenes of a service, delete one
void add_slices_command(CLI::App& app);      // a stack of plane maps becomes a scene, slice by slice
void add_touch_command(CLI::App& app);       // operator side: servo, device, link
void add_watch_command(CLI::App& app);       // a live page of a session, or of a recording

}  // namespace teletact::client
