// A haptic device on the command line, or in a file that a lab keeps for each of its devices.
#pragma once

#include <string>

#include "client/commands/commands.h"
#include "client/haptic/workspace.h"

namespace teletact::client {

// Option groups by the kind of the device: the options of one kind are refused for the other.
inline constexpr const char* kRealDevice = "Real device (plugin:, inverse3)";
inline constexpr const char* kSimulatedDevice = "Simulated device and its hand";

// --device-settings: a TOML file with --device and the options of both groups, which the command line
// overrides. Values are checked as on the command line; errors name the file, the line and the key.
void add_device_settings(CLI::App& command);

// --axes, --rotation-deg, --clutch-button, --device-without-noise.
void add_workspace_options(CLI::App& command, WorkspaceOptions& workspace);
// --scale, --force-scale.
void add_scale_options(CLI::App& command, WorkspaceOptions& workspace);

// Throws UsageError for an option that `device` does not have, or a workspace that is not allowed.
void require_device_options(const CLI::App& command, const std::string& device,
                            const WorkspaceOptions& workspace);

}  // namespace teletact::client
