#include "client/session/adapter_watch.h"

#include <fmt/format.h>

#include <algorithm>
#include <utility>

namespace teletact::client {

std::string AdapterWatch::message(HapticDevice& device, std::uint64_t ticks, double now_s) {
  const double still_s = ticks_.still_s(ticks, now_s);
  if (!stuck_ && still_s >= TickWatch::kStuckS) {
    stuck_ = true;
    device.let_go();
    return fmt::format(
        "the servo has made no tick for {:.1f} s: the device's adapter does not return from a "
        "call, and was asked to let go",
        still_s);
  }
  longest_s_ = std::max(longest_s_, device.longest_call_s());
  if (longest_s_ < kSlowS || now_s < next_s_) return "";
  next_s_ = now_s + kEveryS;
  return fmt::format(
      "the device's adapter took {:.1f} ms for a call: it waited, which read() and write() may "
      "not, or this machine is too busy",
      1e3 * std::exchange(longest_s_, 0));
}

}  // namespace teletact::client
