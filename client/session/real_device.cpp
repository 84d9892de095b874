#include "client/session/real_device.h"

#include <spdlog/spdlog.h>

namespace teletact::client {

void say_workspace(const WorkspaceOptions& options, const DeviceProfile& profile) {
  if (options.scale != 1 || options.force_scale != 1)
    spdlog::info(
        "scaled: 1 mm of the device is {:g} mm of the scene, 1 N of the tissue is {:g} N at the hand; tissue "
        "harder than {:.0f} N/m or beyond {:.2f} N is felt softer",
        options.scale, options.force_scale, profile.largest_stiffness_n_m, profile.largest_force_n);
  if (options.clutch_button > 0)
    spdlog::info("button {} clutches: while it is down the finger stands still and the device moves",
                 options.clutch_button);
}

void say_news(WorkspaceDevice& device) {
  if (const std::string trouble = device.trouble(); !trouble.empty()) spdlog::warn("{}", trouble);
  Reach reach;
  if (!device.reach().take(reach)) return;
  const Vector3 from_m = reach.centre_m.array() - reach.radius_m,
                to_m = reach.centre_m.array() + reach.radius_m;
  spdlog::info("within reach: x from {:.3f} to {:.3f} m, z from {:.3f} to {:.3f} m, down to {:.3f} m",
               from_m.x(), to_m.x(), from_m.z(), to_m.z(), to_m.y());
}

}  // namespace teletact::client
