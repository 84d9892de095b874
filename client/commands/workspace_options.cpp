#include "client/commands/workspace_options.h"

namespace teletact::client {

const std::vector<std::string> kWorkspaceOptions = {
    "--axes", "--rotation-deg", "--clutch-button", "--device-without-noise", "--scale", "--force-scale"};

void add_workspace_options(CLI::App& command, WorkspaceOptions& workspace) {
  command
      .add_option("--axes", workspace.axes,
                  "of a real device: which of its axes moves the finger along x, y and z, such as z,y,-x")
      ->capture_default_str();
  command
      .add_option("--rotation-deg", workspace.rotation_deg,
                  "of a real device: how far it stands turned to the left, seen from above")
      ->capture_default_str();
  command.add_option("--clutch-button", workspace.clutch_button,
                     "of a real device: while this one is down the finger stands still and the device moves; "
                     "without it no button does");
  command.add_flag(
      "--device-without-noise", workspace.without_noise,
      "of a real device: its positions come in steps without noise, so that one that stands still "
      "to the last bit under force for 0.1 s is no FAULT");
}

void add_scale_options(CLI::App& command, WorkspaceOptions& workspace) {
  command
      .add_option("--scale", workspace.scale,
                  "metres of the scene per metre of a real device, 1 to 20: stiffness at the hand is as many "
                  "times the tissue's, unless --force-scale takes it back")
      ->capture_default_str();
  command
      .add_option("--force-scale", workspace.force_scale,
                  "newtons at the hand per newton of the tissue, 0.05 to --scale")
      ->capture_default_str();
}

void require_workspace(const WorkspaceOptions& workspace) {
  try {
    validate(workspace);
  } catch (const std::invalid_argument& error) {
    throw UsageError(with_flags(error.what(), {{"axes", "--axes"},
                                               {"rotation_deg", "--rotation-deg"},
                                               {"force_scale", "--force-scale"},
                                               {"scale", "--scale"},
                                               {"clutch_button", "--clutch-button"}}));
  }
}

}  // namespace teletact::client
