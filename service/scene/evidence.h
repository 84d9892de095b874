// What a window's modulus was made of and what makes it doubtful, kept with the window, and what each doubt
// does to a touch.
#pragma once

#include <chrono>
#include <string>
#include <string_view>
#include <vector>

namespace teletact::service {

struct WindowEvidence {
  // What makes the estimate doubtful, each "name: words for people".
  std::vector<std::string> warnings;
  double log_deviation = 0;  // median standard deviation of log E over the measured cells; 0: not known
  double correlation_m = 0;  // errors of log E at two places correlate by exp(-distance / it); 0: not known
  double force_relative_deviation = 0;  // of the force sensor, over the force
  double area_relative_deviation = 0;   // of the contact area
  double background_modulus_pa = 0, quality = 0;
  double measured_share = 0;  // of the window's cells; the rest is extended from them
  // When the last byte of its RF came in; the epoch where that is not known (read from disk after a restart).
  std::chrono::steady_clock::time_point taken_in{};
};

// What a doubt does to a touch on its window.
enum class FlagEffect {
  kRemark,   // the answer says it and stands
  kDegrade,  // the answer is not to be trusted
};

// A window that no other one adjoins: its modulus' scale could not be compared with a neighbour's.
constexpr const char* kLoneFlag = "lone";
constexpr const char* kLoneWarning =
    "lone: no window adjoins this one; its scale, which the probe's force sets, could not be compared with a "
    "neighbour's";

// The name of a warning, what stands before its colon.
std::string_view flag_of(std::string_view warning);
// The table. A name that it does not know is a remark.
FlagEffect effect_of(std::string_view flag);

}  // namespace teletact::service
