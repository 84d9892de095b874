#include "service/contact/corrector.h"

#include <spdlog/spdlog.h>

#include <algorithm>
#include <cmath>
#include <string>
#include <utility>

#include "service/base/choices.h"

namespace teletact::service {
namespace {

// A correction is used from its end until the next one's.
constexpr double kAimed = 2;
// Farther ahead nobody knows where a finger will be; nearer to each other two poses are one finger's.
constexpr double kMaxAheadM = 0.008, kSameFingerM = 0.010;
constexpr double kNewest = 0.3;  // share of the last correction in how long they last

double distance_m(const Vector3& a, const Vector3& b) {
  return std::hypot(a[0] - b[0], a[1] - b[1], a[2] - b[2]);
}

}  // namespace

TouchPose moved_on(const TouchPose& pose, double seconds) {
  const auto [vx, vy, vz] = pose.velocity_m_s;
  const double speed = std::hypot(vx, vz), turn = pose.turn_rad_s;
  if (speed * seconds > kMaxAheadM) seconds = kMaxAheadM / speed;
  const bool turns = std::abs(turn * seconds) > 1e-6;
  const double ahead = turns ? std::sin(turn * seconds) / turn : seconds,
               aside = turns ? (1 - std::cos(turn * seconds)) / turn : 0;
  TouchPose at = pose;
  at.position_m[0] += ahead * vx - aside * vz;
  at.position_m[2] += ahead * vz + aside * vx;
  const double depth = pose.position_m[1];
  at.position_m[1] = std::clamp(depth + seconds * vy, depth / 2, 3 * depth / 2);
  return at;
}

Corrector::~Corrector() {
  {
    const std::lock_guard lock(mutex_);
    ends_ = true;
  }
  changed_.notify_all();
  if (thread_.joinable()) thread_.join();
}

void Corrector::ask(const Fingertip& tip, const TouchPose& pose) {
  {
    const std::lock_guard lock(mutex_);
    const auto own = std::find_if(hints_.begin(), hints_.end(), [&](const Hint& hint) {
      return hint.tip == tip && distance_m(hint.pose.position_m, pose.position_m) < kSameFingerM;
    });
    if (own != hints_.end()) {
      own->pose = pose;
      return;
    }
    hints_.push_back({tip, pose});
    if (hints_.size() > kMaxFingers) hints_.pop_front();
    if (!thread_.joinable()) thread_ = std::thread([this] { run(); });
  }
  changed_.notify_all();
}

std::uint64_t Corrector::done() const {
  const std::lock_guard lock(mutex_);
  return done_;
}

bool Corrector::wait_for_more_than(std::uint64_t done, Clock::time_point until) {
  std::unique_lock lock(mutex_);
  return changed_.wait_until(lock, until, [&] { return done_ > done; });
}

std::exception_ptr Corrector::failure() const {
  const std::lock_guard lock(mutex_);
  return failure_;
}

void Corrector::forget_failure() {
  const std::lock_guard lock(mutex_);
  failure_ = nullptr;
}

void Corrector::run() {
  while (true) {
    Hint hint;
    {
      std::unique_lock lock(mutex_);
      changed_.wait(lock, [&] { return ends_ || !hints_.empty(); });
      if (ends_) return;
      hint = hints_.front();
      hints_.pop_front();
      hint.pose = moved_on(hint.pose, kAimed * lasts_s_);
    }
    meet(hint);
    changed_.notify_all();
  }
}

void Corrector::meet(const Hint& hint) {
  const auto begun = Clock::now();
  std::exception_ptr failure;
  std::string why;
  try {
    correct_(hint.tip, hint.pose);
  } catch (const std::exception& error) {
    failure = std::current_exception(), why = error.what();
  }
  const double lasted_s = std::chrono::duration<double>(Clock::now() - begun).count();
  const std::lock_guard lock(mutex_);
  if (failure && why != said_) spdlog::warn("event=correction_failed error=\"{}\"", why);
  said_ = why;
  failure_ = failure;
  if (!failure) lasts_s_ += (lasts_s_ > 0 ? kNewest : 1) * (lasted_s - lasts_s_);
  ++done_;
}

}  // namespace teletact::service
