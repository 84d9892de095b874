// The simulated robot arm that carries the probe: pure kinematics on times that the caller gives.
//
// One acquisition is a chain of straight moves, each with a trapezoidal speed profile that starts and ends at
// rest: sideways (lifted clear of the skin), down to first contact, [pre frame], compress, [post frame],
// lift. Frames exist only at the ticks of the scanner's frame rate, counted from time 0.
#pragma once

namespace teletact::client {

struct ArmLimits {
  double speed_m_s = 0.3;
  double acceleration_m_s2 = 3.0;
  double lift_m = 0.002;    // clearance between probe face and skin while moving sideways
  double settle_s = 0.005;  // rest before a frame may be taken
  double frame_rate_hz = 50;
};

// Duration (s) of a rest-to-rest move over |distance_m| with a trapezoidal (or triangular) speed profile.
double move_duration_s(double distance_m, double speed_m_s, double acceleration_m_s2);

// When each step of one acquisition ends, seconds on the caller's clock.
struct ArmSchedule {
  double begin_s = 0;
  double contact_s = 0;  // probe face on the skin
  double pre_frame_s = 0;
  double compressed_s = 0;
  double post_frame_s = 0;
  double lifted_s = 0;  // free for the next move
};

class RobotArm {
 public:
  // The arm rests lifted at `window_x_m`, the left border of the probe's footprint, from time `now_s`. Throws
  // std::invalid_argument on limits <= 0.
  RobotArm(const ArmLimits& limits, double window_x_m, double now_s);

  // Plans the acquisition of the window at `window_x_m` with compression `compression_m` > 0, beginning at
  // `now_s` or when the last one has lifted, whichever is later. Lateral moves are made lifted only.
  ArmSchedule acquire(double window_x_m, double compression_m, double now_s);

  double free_s() const { return free_s_; }  // when all that is planned has ended

 private:
  double next_frame_s(double not_before_s) const;

  ArmLimits limits_;
  double window_x_m_, free_s_;  // at the end of the last planned move, and when that is
};

}  // namespace teletact::client
