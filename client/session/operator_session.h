// One session of touching: device, renderer, servo thread, link and recording, wired together. What
// `teletact-client touch` runs.
#pragma once

#include <atomic>
#include <functional>
#include <optional>
#include <string>
#include <vector>

#include "client/link/credentials.h"
#include "client/link/touch_link.h"
#include "client/servo/servo_thread.h"
#include "client/servo/tick_statistics.h"
#include "client/session/devices.h"

namespace teletact::client {

struct OperatorSessionOptions {
  static constexpr double kTactileS = 0.2;
  std::string address;
  Credentials credentials;
  v1::TouchOpen open;
  std::string device = "simulated";     // as devices.h reads it
  std::string profile = "premium-1.5";  // of a simulated or replayed device
  std::string renderer = "law";         // or kalman
  WorkspaceOptions workspace;           // of a real device
  HandOptions hand;                     // of a simulated device; its places: see below
  std::optional<double> begin_m;        // of the sweep; absent: the tip's reach within what is covered
  std::optional<double> end_m;
  std::optional<double> across_m;   // where the sweep's line lies; absent: amid the tissue
  std::optional<double> start_x_m;  // where a real device begins; absent: amid what is covered
  unsigned passes = 0;              // end after so many sweeps; 0 = no limit
  double duration_s =
      0;  // end after so long with force on, or lost for over lost_s at a stretch; 0 = no limit
  double lost_s = 5;
  double wait_s = 0;        // for the service, the scene and its first window
  double connect_s = 2;     // for the service, at least
  double still_s = 3;       // of standing still before a person is told what is waited for
  std::string record_path;  // empty: no recording
  std::vector<std::string> arguments;
  // The key that was pressed, 0 for none: Enter resumes, Space pauses, c clutches a real device and releases
  // it, h hands the lease of the probe over.
  // Empty: there are no keys.
  std::function<char()> key;
  // Where tactile images go, some of them, at most every kTactileS. Empty: nowhere.
  std::function<void(const TactileImage&)> tactile;
  std::string hand_over_to;  // session_id of another touch; empty: h does nothing
  bool real_time = true;     // ask for SCHED_FIFO and locked memory
  // ServoThread::Options::begins and ended.
  std::function<void()> servo_begins = [] {};
  std::function<void()> servo_ended = [] {};
};

struct TouchSummary {
  std::string device;  // its profile's name
  TickStatistics ticks;
  TouchLinkStats link;
  RealTime real_time;
  std::uint64_t overruns = 0;
  std::uint64_t rejected_answers = 0;
  std::uint64_t telemetry_dropped = 0;
  std::uint64_t record_dropped = 0;
  unsigned passes = 0;
};

// Runs until passes or duration are reached, a replayed motion is over, `stop` is set, or the link gives up.
// Throws std::runtime_error or std::invalid_argument with one line for the user: no service, unknown scene,
// nothing touchable, unknown device, profile or renderer, unwritable recording. Whatever is thrown, the force
// has been slewed to zero and the device closed by then. An adapter that does not return from a call ends the
// process (servo_thread.h).
TouchSummary run_operator_session(const OperatorSessionOptions& options, const std::atomic<bool>& stop);

}  // namespace teletact::client
