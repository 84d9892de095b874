// Variance that a renderer without a model of its own reports: the mean square of what the stiffness changed
// by from one answer to the next, which is what a held value is off by when its successor arrives.
#pragma once

namespace teletact::client {

class HeldVariance {
 public:
  void add(double stiffness_n_m) noexcept {
    constexpr double kShare = 0.2;  // of the newest change in the running mean
    const double change_n_m = stiffness_n_m - last_n_m_;
    if (known_) value_ += kShare * (change_n_m * change_n_m - value_);
    last_n_m_ = stiffness_n_m;
    known_ = true;
  }
  double value() const noexcept { return value_; }  // (N/m)^2

 private:
  bool known_ = false;
  double last_n_m_ = 0;
  double value_ = 0;
};

}  // namespace teletact::client
