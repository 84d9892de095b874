// What a person is told of a real device: its workspace in the scene, and what it says of itself.
#pragma once

#include "client/haptic/workspace.h"

namespace teletact::client {

// Of an open device; `profile`: in the scene.
void say_workspace(const WorkspaceOptions& options, const DeviceProfile& profile);

// What is new since this was called last: its trouble, what of the scene is within reach.
void say_news(WorkspaceDevice& device);

}  // namespace teletact::client
