#include "client/session/tick_log.h"

#include <fmt/format.h>

#include "client/clock/clock.h"

namespace teletact::client {
namespace {

std::string degraded(const ServoTick& tick) {
  if (tick.withholds)
    return fmt::format(
        "DEGRADED, {:.0f} % of the force withheld{}; lift the finger and press again", 100 * tick.withheld,
        tick.refused.lacks_j > 0
            ? fmt::format(": {} needs {:.1f} mJ more", name(tick.refused.who), 1e3 * tick.refused.lacks_j)
            : "");
  if (tick.sequence == 0) return "DEGRADED, no force: no answer to render yet";
  return tick.energy_generated
             ? fmt::format("DEGRADED, force fading: the display generated energy, {:.1f} mJ in all",
                           -1e3 * tick.energy_j)
             : fmt::format("DEGRADED, force reduced: the answer behind it is {:.0f} ms old{}",
                           1e3 * tick.model_age_s,
                           2 * tick.round_trip_s > tick.model_age_s
                               ? fmt::format(", the round trip {:.0f} ms", 1e3 * tick.round_trip_s)
                               : "");
}

std::string degraded_by_service(const ServoTick&) {
  return "DEGRADED by the service, felt as it is: the service's warning says why";
}

std::string fading(const ServoTick& tick) {
  return fmt::format("fading, no answer for {:.0f} ms", 1e3 * tick.silence_s);
}

std::string clutched(const ServoTick& tick) {
  return fmt::format("clutched, the finger stands still at x = {:.3f} m", tick.pose.position_m.x());
}

}  // namespace

void TickLog::follow(Spell& spell, bool on, const ServoTick& tick, What what,
                     std::vector<LogMessage>& messages, bool warning) {
  const double time_s = seconds(tick.time_ns);
  if (on && !spell.on) {
    spell.begin_s = time_s;
    spell.logged = time_s - spell.logged_s >= kEveryS;
    if (spell.logged) {
      const std::string more =
          spell.left_out > 0 ? fmt::format("; {} times more since the last such line", spell.left_out) : "";
      messages.push_back({warning, "servo " + what(tick) + more});
      spell.logged_s = time_s;
      spell.left_out = 0;
    } else {
      ++spell.left_out;
    }
  }
  // Where the state took the force, nothing got better.
  if (!on && spell.on && spell.logged && tick.state == ServoState::kEnabled) {
    const std::string text = what(tick);
    messages.push_back({false, fmt::format("servo no longer {}, after {:.2f} s",
                                           text.substr(0, text.find(',')), time_s - spell.begin_s)});
  }
  spell.on = on;
}

// In contact alone: above the tissue nobody feels which it is.
void TickLog::follow_law(const ServoTick& tick, std::vector<LogMessage>& messages) {
  const double time_s = seconds(tick.time_ns);
  if (tick.by_law == by_law_ || tick.force_n.isZero(0) || time_s - by_law_s_[by_law_ ? 1 : 0] < kEveryS ||
      time_s - by_law_s_[tick.by_law ? 1 : 0] < kLawEveryS)
    return;
  by_law_ = tick.by_law;
  by_law_s_[by_law_ ? 1 : 0] = time_s;
  const std::string link = fmt::format("the round trip is {:.0f} ms", 1e3 * tick.round_trip_s);
  messages.push_back({false, by_law_
                                 ? "the force is a contact law's: that of where the finger is; " + link
                                 : "no contact law here: the force is that of the newest answer; " + link});
}

std::vector<LogMessage> TickLog::add(const ServoTick& tick) {
  std::vector<LogMessage> messages;
  if (!started_ || tick.state != last_.state || tick.reason != last_.reason) {
    const bool trouble = tick.reason == StateReason::kSilence || tick.state == ServoState::kFault;
    messages.push_back({trouble, fmt::format("servo {}: {}", name(tick.state), describe(tick.reason))});
  }
  if (tick.resume_refused && seconds(tick.time_ns) - refused_s_ >= kEveryS) {
    refused_s_ = seconds(tick.time_ns);
    messages.push_back({true, fmt::format("resume ignored: {}", tick.resume_refused)});
  }
  const bool enabled = tick.state == ServoState::kEnabled;
  follow(degraded_, enabled && tick.degraded, tick, degraded, messages);
  follow(service_degraded_, enabled && tick.service_degraded, tick, degraded_by_service, messages);
  follow(faded_, enabled && tick.faded, tick, fading, messages);
  follow(clutched_, enabled && tick.clutched, tick, clutched, messages, false);
  if (enabled) follow_law(tick, messages);
  started_ = true;
  last_ = tick;
  return messages;
}

}  // namespace teletact::client
