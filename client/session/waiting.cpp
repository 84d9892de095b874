#include "client/session/waiting.h"

#include <fmt/format.h>

namespace teletact::client {

Waiting::For Waiting::waited_for(const TouchSituation& situation) {
  if (!situation.trouble.empty()) return For::kStream;
  if (!situation.device_ok) return For::kDevice;
  if (situation.state != ServoState::kEnabled) return For::kButton;
  if (situation.width_m > 0 && (situation.x_m < 0 || situation.x_m > situation.width_m)) return For::kTissue;
  return situation.held_at_border || !situation.covered ? For::kWindow : For::kNothing;
}

std::string Waiting::message(const TouchSituation& situation, double now_s) {
  const For now = waited_for(situation);
  if (now != for_) due_s_ = now_s + first_s_;
  for_ = now;
  if (now == For::kNothing || now_s < due_s_) return "";
  due_s_ = now_s + (now == For::kStream ? kTroubleS : kRepeatS);
  if (now == For::kStream) return "no force: waiting for the service (" + situation.trouble + ")";
  if (now == For::kDevice)
    return "no force: waiting for the device, which cannot be read or written, or states no position yet "
           "(all "
           "zero): see to its cable, power and calibration";
  if (now == For::kButton)
    return fmt::format(
        "no force: waiting for the operator to press the device's button{} (resume), with the finger lifted "
        "out of the tissue",
        situation.has_keys ? ", or Enter here" : "");
  if (now == For::kTissue)
    return fmt::format("the finger is beside the tissue, at x = {:.3f} m: move it back to 0 to {:.3f} m",
                       situation.x_m, situation.width_m);
  return fmt::format(
      "waiting for a window at x = {:.3f} m: none is acquired there (start acquire, or wait "
      "until it comes by)",
      situation.x_m);
}

}  // namespace teletact::client
