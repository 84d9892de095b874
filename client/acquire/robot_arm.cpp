#include "client/acquire/robot_arm.h"

#include <algorithm>
#include <cmath>
#include <stdexcept>

namespace teletact::client {

double move_duration_s(double distance_m, double speed_m_s, double acceleration_m_s2) {
  const double distance = std::abs(distance_m);
  const double ramps = speed_m_s * speed_m_s / acceleration_m_s2;  // distance used up by both ramps
  if (distance < ramps) return 2 * std::sqrt(distance / acceleration_m_s2);
  return distance / speed_m_s + speed_m_s / acceleration_m_s2;
}

RobotArm::RobotArm(const ArmLimits& limits, double window_x_m, double now_s)
    : limits_(limits), window_x_m_(window_x_m), free_s_(now_s) {
  if (!(limits.speed_m_s > 0 && limits.acceleration_m_s2 > 0 && limits.frame_rate_hz > 0 &&
        limits.lift_m > 0 && limits.settle_s >= 0))
    throw std::invalid_argument("arm limits: speed, acceleration, lift and frame rate must be above 0");
}

ArmSchedule RobotArm::acquire(double window_x_m, double compression_m, double now_s) {
  if (!(compression_m > 0)) throw std::invalid_argument("arm: the compression must be above 0");
  const auto move_s = [this](double distance_m) {
    return move_duration_s(distance_m, limits_.speed_m_s, limits_.acceleration_m_s2);
  };
  ArmSchedule schedule;
  schedule.begin_s = std::max(now_s, free_s_);
  schedule.contact_s = schedule.begin_s + move_s(window_x_m - window_x_m_) + move_s(limits_.lift_m);
  schedule.pre_frame_s = next_frame_s(schedule.contact_s + limits_.settle_s);
  schedule.compressed_s = schedule.pre_frame_s + move_s(compression_m);
  schedule.post_frame_s = next_frame_s(schedule.compressed_s + limits_.settle_s);
  schedule.lifted_s = schedule.post_frame_s + move_s(compression_m + limits_.lift_m);
  window_x_m_ = window_x_m;
  free_s_ = schedule.lifted_s;
  return schedule;
}

double RobotArm::next_frame_s(double not_before_s) const {
  // A tick that lies within rounding of the limit counts as reached.
  return std::ceil(not_before_s * limits_.frame_rate_hz - 1e-9) / limits_.frame_rate_hz;
}

}  // namespace teletact::client
