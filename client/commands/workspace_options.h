// Where a real device's workspace lies in the scene, on the command line.
#pragma once

#include <string>
#include <vector>

#include "client/commands/commands.h"
#include "client/haptic/workspace.h"

namespace teletact::client {

// All of the below.
extern const std::vector<std::string> kWorkspaceOptions;

// --axes, --rotation-deg, --clutch-button, --device-without-noise.
void add_workspace_options(CLI::App& command, WorkspaceOptions& workspace);
// --scale, --force-scale.
void add_scale_options(CLI::App& command, WorkspaceOptions& workspace);

// Throws CommandError naming the option.
void require_workspace(const WorkspaceOptions& workspace);

}  // namespace teletact::client
