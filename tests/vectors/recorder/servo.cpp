#include <cmath>
#include <cstdint>
#include <limits>
#include <string>

#include "tests/vectors/recorder/product.h"
#include "tests/vectors/recorder/record.h"

namespace teletact::vectors {
namespace {

constexpr int kTicks = 10000, kCycle = 2500;  // ms; a cycle is one press
constexpr std::int64_t kMillisecond = 1'000'000;

struct Pose {
  double x_m = 0, y_m = 0;
};

// 0 below 0, 1 above 1, a cubic between.
double smooth_step(double t) {
  if (t <= 0) return 0;
  return t >= 1 ? 1 : t * t * (3 - 2 * t);
}

// Hovers 3 mm above the surface, presses, sweeps while it sways, and lifts; to one side and back again.
Pose pose_at(int tick) {
  const int in_cycle = tick % kCycle, cycle = tick / kCycle;
  const double way = smooth_step((in_cycle - 500) / 1600.0);
  const double pressed = smooth_step((in_cycle - 300) / 150.0) - smooth_step((in_cycle - 2200) / 150.0);
  const double sway = 0.0004 * (smooth_step(std::abs(in_cycle % 800 - 400) / 400.0) - 0.5);
  return {0.02 + 0.08 * (cycle % 2 == 0 ? way : 1 - way), -0.003 + (0.007 + sway) * pressed};
}

// Tissue in closed form without functions that differ between libraries: U = K(x) d^2.5, K with bumps
// (c - 1) / (1 + u^2)^2, times `scale`.
ForceAnswer answer_at(const Pose& pose, double scale) {
  constexpr double kStiffness = 950, kLightTouchM = 5e-4;  // N / m^1.5
  constexpr struct {
    double x_m, contrast, width_m;
  } kBumps[] = {{0.03, 2, 0.008}, {0.06, 3, 0.010}, {0.09, 1.5, 0.006}};
  double k = scale * kStiffness, slope = 0, curvature = 0;
  for (const auto& bump : kBumps) {
    const double u = (pose.x_m - bump.x_m) / bump.width_m, q = 1 + u * u;
    const double height = scale * kStiffness * (bump.contrast - 1);
    k += height / (q * q);
    slope += height / bump.width_m * -4 * u / (q * q * q);
    curvature += height / (bump.width_m * bump.width_m) * (24 * u * u / (q * q * q * q) - 4 / (q * q * q));
  }
  ForceAnswer a;
  a.contact = pose.y_m > 0;
  a.foreseen = !a.contact;
  a.x_m = pose.x_m;
  a.y_m = a.contact ? pose.y_m : kLightTouchM;
  const double d = a.y_m, root = std::sqrt(d);
  a.force_n = {-slope * d * d * root, -2.5 * k * d * root};
  a.tangent_n_m = {-curvature * d * d * root, -2.5 * slope * d * root, -2.5 * slope * d * root,
                   -3.75 * k * root};
  return a;
}

// Ticks wake up to 0.1 ms late.
std::int64_t time_of(int tick) {
  return (1000 + tick) * kMillisecond + tick * 7919 % 101 * 1000;
}

// Every 4 ms, 4 to 8 ms old; now and then some are missing, late or bad.
std::optional<ForceAnswer> answer_of(int tick) {
  constexpr int kEvery = 4;
  const bool silent = tick >= 3700 && tick < 3950, burst_lost = tick % 400 >= 380;
  if (tick < 10 || tick % kEvery != 0 || silent || burst_lost) return {};
  const int asked = tick - kEvery - tick / kEvery % 5;
  const bool harder = tick >= 6200 && tick < 8000;  // a newer modulus
  ForceAnswer a = answer_at(pose_at(asked), harder ? 1.6 : 1);
  a.sequence = static_cast<std::uint64_t>(tick);
  a.pose_time_s = 1e-9 * static_cast<double>(time_of(asked));
  a.has_force = tick < 1400 || tick >= 1420;
  a.degraded = tick >= 1600 && tick < 1700;
  if (tick == 1200) a.force_n[0] = std::numeric_limits<double>::quiet_NaN();
  if (tick == 1240) a.sequence = 7;        // out of order
  if (tick == 1280) a.pose_time_s += 100;  // of the future
  return a;
}

TickCase case_of(int tick) {
  const Pose now = pose_at(tick), before = pose_at(tick > 0 ? tick - 1 : 0);
  TickCase c;
  c.time_ns = time_of(tick);
  c.x_m = now.x_m;
  c.y_m = now.y_m;
  c.velocity_x_m_s = 1000 * (now.x_m - before.x_m);
  c.velocity_y_m_s = 1000 * (now.y_m - before.y_m);
  c.resume = tick % kCycle >= 100 && tick % kCycle < 200;
  c.pause = tick == 7200;
  c.device_answers = tick != 9000;
  c.answer = answer_of(tick);
  return c;
}

}  // namespace

void record_servo(Recording& recording) {
  Servo servo;
  for (int tick = 0; tick < kTicks; ++tick)
    for (const Named& part : servo.tick(case_of(tick)))
      recording.append(std::string("servo/kalman/") + part.name, part.values.size(), part.values,
                       part.exact ? kExact : kServo);
}

Recording record_all() {
  Recording recording;
  record_estimates(recording);
  record_touches(recording);
  record_servo(recording);
  return recording;
}

}  // namespace teletact::vectors
