// Variance that a renderer without a model of its own reports: what the stiffness changed by from one answer
// to the next, as far as the tool has come since.
#pragma once

#include <algorithm>
#include <array>
#include <limits>

#include "client/render/renderer.h"
#include "client/render/tissue_walk.h"

namespace teletact::client {

constexpr double kNewestShare = 0.2;  // of the newest change in a running mean

// Mean square of the changes of one value, (N/m)^2.
class HeldVariance {
 public:
  void add(double stiffness_n_m) noexcept {
    const double change_n_m = stiffness_n_m - last_n_m_;
    if (known_) value_ += kNewestShare * (change_n_m * change_n_m - value_);
    last_n_m_ = stiffness_n_m;
    known_ = true;
  }
  double value() const noexcept { return value_; }
  double newest_n_m() const noexcept { return last_n_m_; }

 private:
  bool known_ = false;
  double last_n_m_ = 0;
  double value_ = 0;
};

// Of the stiffness of the newest answer, its components in the contact (ContactFrame), at a tool somewhere
// else and later.
class HeldUncertainty {
 public:
  void add(const Vector3& stiffness_n_m, const Vector3& position_m, double pose_time_s) noexcept {
    if (answers_ > 0) {
      const double walked = walked_s(pose_time_s - time_s_, (position_m - position_m_).norm());
      interval_s_ += kNewestShare * (walked - interval_s_);
    }
    for (int i = 0; i < 3; ++i) changes_[static_cast<std::size_t>(i)].add(stiffness_n_m[i]);
    position_m_ = position_m;
    time_s_ = pose_time_s;
    answers_ = std::min(answers_ + 1, 2);
  }

  // (N/m)^2; infinite before the first answer. Of one answer nothing says how it changes: what tissue is
  // taken to change by; that is the least too for the way gone, since a finger at rest learns nothing of
  // others.
  Vector3 at(const Vector3& position_m, double time_s) const noexcept {
    if (answers_ == 0) return Vector3::Constant(std::numeric_limits<double>::infinity());
    const double age_s = time_s - time_s_, way_m = (position_m - position_m_).norm();
    const double walk_n_m = std::max(kWalkShare * changes_[1].newest_n_m(), kWalkNM);
    const double least = walk_n_m * walk_n_m * walked_s(answers_ > 1 ? 0 : age_s, way_m);
    const double intervals = interval_s_ > 0 ? walked_s(age_s, way_m) / interval_s_ : 1;
    const auto of = [&](const HeldVariance& changes) { return std::max(least, intervals * changes.value()); };
    return {of(changes_[0]), of(changes_[1]), of(changes_[2])};
  }

 private:
  std::array<HeldVariance, 3> changes_;
  Vector3 position_m_ = Vector3::Zero();
  double time_s_ = 0;
  double interval_s_ = 0;  // of walk between answers, the same running mean
  int answers_ = 0;        // 2: that or more
};

}  // namespace teletact::client
