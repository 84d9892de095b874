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

double move_progress(double elapsed_s, double distance_m, double speed_m_s, double acceleration_m_s2) {
  const double distance = std::abs(distance_m);
  const double duration = move_duration_s(distance, speed_m_s, acceleration_m_s2);
  if (elapsed_s >= duration) return 1;  // also the move of no length
  if (elapsed_s <= 0) return 0;
  // The profile is symmetric in time: what is left is the mirror image of what was done.
  const bool second_half = elapsed_s > duration / 2;
  const double t = second_half ? duration - elapsed_s : elapsed_s;
  const double ramp = std::min(speed_m_s / acceleration_m_s2, duration / 2);
  const double way = t <= ramp ? acceleration_m_s2 * t * t / 2
                               : acceleration_m_s2 * ramp * ramp / 2 + acceleration_m_s2 * ramp * (t - ramp);
  return second_half ? 1 - way / distance : way / distance;
}

RobotArm::RobotArm(const ArmLimits& limits, double window_x_m, double now_s)
    : limits_(limits), rest_{window_x_m, -limits.lift_m}, free_s_(now_s) {
  if (!(limits.speed_m_s > 0 && limits.acceleration_m_s2 > 0 && limits.frame_rate_hz > 0 &&
        limits.lift_m > 0 && limits.settle_s >= 0))
    throw std::invalid_argument("arm limits: speed, acceleration, lift and frame rate must be above 0");
}

ArmSchedule RobotArm::acquire(double window_x_m, double compression_m, double now_s) {
  if (!(compression_m > 0)) throw std::invalid_argument("arm: the compression must be above 0");
  ArmSchedule schedule;
  moves_.clear();
  schedule.begin_s = std::max(now_s, free_s_);
  move_to({window_x_m, -limits_.lift_m}, schedule.begin_s);
  schedule.above_s = free_s_;
  move_to({window_x_m, 0}, free_s_);
  schedule.contact_s = free_s_;
  schedule.pre_frame_s = next_frame_s(schedule.contact_s + limits_.settle_s);
  move_to({window_x_m, compression_m}, schedule.pre_frame_s);
  schedule.compressed_s = free_s_;
  schedule.post_frame_s = next_frame_s(schedule.compressed_s + limits_.settle_s);
  move_to({window_x_m, -limits_.lift_m}, schedule.post_frame_s);
  schedule.lifted_s = free_s_;
  return schedule;
}

ArmPose RobotArm::pose(double time_s) const {
  ArmPose pose = moves_.empty() ? rest_ : moves_.front().from;
  for (const Move& move : moves_) {
    if (time_s < move.begin_s) break;
    const double dx = move.to.window_x_m - move.from.window_x_m, dy = move.to.depth_m - move.from.depth_m;
    const double share = move_progress(time_s - move.begin_s, std::abs(dx) + std::abs(dy), limits_.speed_m_s,
                                       limits_.acceleration_m_s2);
    pose = {move.from.window_x_m + share * dx, move.from.depth_m + share * dy};
  }
  return pose;
}

// Every move is along one axis, so its length is the change of that coordinate.
void RobotArm::move_to(const ArmPose& target, double begin_s) {
  const double length =
      std::abs(target.window_x_m - rest_.window_x_m) + std::abs(target.depth_m - rest_.depth_m);
  const double end_s = begin_s + move_duration_s(length, limits_.speed_m_s, limits_.acceleration_m_s2);
  moves_.push_back({begin_s, end_s, rest_, target});
  rest_ = target;
  free_s_ = end_s;
}

double RobotArm::next_frame_s(double not_before_s) const {
  // A tick that lies within rounding of the limit counts as reached.
  return std::ceil(not_before_s * limits_.frame_rate_hz - 1e-9) / limits_.frame_rate_hz;
}

}  // namespace teletact::client
