// Whether a hand that has stopped comes to rest: by the decay of its swing over whole sampling periods, since
// slow updates and delays make what converges converge slowly.
#pragma once

#include <Eigen/Core>
#include <limits>

namespace teletact::bench {

enum class Verdict { kStable, kLimitCycle, kUnstable };
const char* to_string(Verdict);

struct RestOptions {
  double update_s = 0.001;  // between answers
  double delay_s = 0;       // of force and model together
  double min_s = 1;
  double unfelt_m = 3e-5;  // a swing below this is none: what quantisation alone makes a hand tremble by
};

class RestWatch {
 public:
  explicit RestWatch(const RestOptions&);
  // At least 40 (update + delay).
  double length_s() const noexcept { return length_s_; }
  // A place, `time_s` after the stop, in order.
  void add(const Eigen::Vector3d& position_m, double time_s) noexcept;
  // Nothing has moved over one window: nothing will.
  bool settled() const noexcept { return settled_; }
  // Stable: the last window's swing is not felt, or less than 0.8 of that of the window that ends half way.
  Verdict verdict() const noexcept;
  double swing_m() const noexcept;  // peak to peak over the last window

 private:
  struct Swing {
    Eigen::Vector3d low = Eigen::Vector3d::Constant(std::numeric_limits<double>::infinity());
    Eigen::Vector3d high = -low;
    void add(const Eigen::Vector3d& position_m) {
      low = low.cwiseMin(position_m);
      high = high.cwiseMax(position_m);
    }
    double peak_to_peak_m() const { return (high - low).norm(); }
  };
  double unfelt_m_, window_s_, length_s_;
  Swing now_, half_, last_;
  double now_end_s_;
  bool settled_ = false;
};

}  // namespace teletact::bench
