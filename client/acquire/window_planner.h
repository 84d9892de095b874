// Which window to acquire next: strategy 1 of (T1). While the finger explores window T, the windows ahead of
// it in its direction of motion are acquired, nearest first, so that it never arrives at one that is unknown.
//
// Windows are adjacent: window k covers [k w, (k + 1) w) of the scene, w the probe's width. With w = 60 mm
// and a finger at 120 mm/s one window must be made every 0.5 s; the arm alone takes ~0.5 s and the service
// computes meanwhile, so looking one window ahead would come too late and the planner looks two ahead.
#pragma once

#include <cstddef>
#include <optional>
#include <vector>

namespace teletact::client {

struct PlannerOptions {
  std::size_t window_count = 1;
  double window_width_m = 0.06;
  std::size_t lookahead = 2;     // windows ahead of the finger's own
  double refresh_after_s = 1.0;  // a window older than this is acquired anew when the finger comes towards it
  // A renewal must be ready before the finger arrives: the model under it changes only when it has to. About
  // what the arm and the service need from asking to publishing.
  double renewal_lead_s = 0.5;
  // Where the finger is, and what is published to it, are told late: unknown windows are asked for as if it
  // had come further by its velocity times this, an operator's round trip.
  double link_s = 0.1;
  double still_m_s = 0.01;  // slower than this the finger has no direction: the last one holds
  bool all = false;  // then the other unknown windows, too, nearest first, whether a finger is there or not
};

struct FingerMotion {
  bool present = false;
  double x_m = 0;
  double velocity_m_s = 0;
  std::optional<double> wished_m = {};  // the service asks for the window there, whatever the finger does
};

// What is known of one window.
struct WindowKnowledge {
  std::optional<double> acquired_s;  // post frame of the newest acquisition, published or under way
  std::size_t frames_left = 0;       // acquisitions that the frame source can still deliver
};

class WindowPlanner {
 public:
  // `start_x_m` is where the finger is expected to begin, `direction` (+1 or -1) where it will go first.
  // Throws std::invalid_argument on zero windows or a width <= 0.
  WindowPlanner(const PlannerOptions& options, double start_x_m, int direction);

  // The window to acquire now, or nothing when all that the finger needs is known and fresh. What is wished
  // comes first, if it is unknown or stale. Unknown windows come before stale ones (which wait until all that
  // lies ahead is known), nearer before further. `windows` has one entry per window.
  std::optional<std::size_t> next(const FingerMotion& finger, const std::vector<WindowKnowledge>& windows,
                                  double now_s);

  std::size_t window_at(double x_m) const;  // clamped to the first and the last window
  double window_x_m(std::size_t window) const { return window * options_.window_width_m; }
  const PlannerOptions& options() const { return options_; }

 private:
  bool stale(const WindowKnowledge& window, double now_s) const;
  double arrival_s(const FingerMotion& finger, std::size_t window) const;  // until the finger enters it
  std::optional<std::size_t> nearest_unknown(const std::vector<WindowKnowledge>& windows) const;
  std::vector<std::size_t> path_ahead(std::size_t lookahead) const;  // the finger's own window first

  PlannerOptions options_;
  double x_m_;
  int direction_;
};

}  // namespace teletact::client
