#include "client/experiment/spring_answers.h"

#include <cmath>

#include "client/clock/clock.h"

namespace teletact::client {
namespace {

constexpr double kForeseenM = 0.0005;  // the light touch that an answer out of contact tells of

std::int64_t nanoseconds(double s) {
  return static_cast<std::int64_t>(std::llround(1e9 * s));
}

}  // namespace

SpringAnswers::SpringAnswers(double period_s, double age_s)
    : period_ns_(nanoseconds(period_s)), age_ns_(nanoseconds(age_s)) {}

void SpringAnswers::present(const SpringTissue& tissue) {
  wanted_ = tissue;
  waits_ = true;
  arrived_ = 0;
}

void SpringAnswers::add(const ServoPose& pose) {
  if (waits_ && pose.pose.position_m.y() <= 0) {
    shown_ = wanted_;
    first_ = sequence_ + 1;
    waits_ = false;
  }
  if (pose.time_ns < next_ns_) return;
  on_the_way_.push_back(answer_to(pose));
  next_ns_ += period_ns_;  // in the mean at its rate, and never in a burst
  if (next_ns_ <= pose.time_ns) next_ns_ = pose.time_ns + period_ns_;
}

ServoAnswer SpringAnswers::answer_to(const ServoPose& pose) {
  ServoAnswer answer;
  answer.covered = true;
  answer.region = {.begin_x_m = -1e3, .end_x_m = 1e3};
  answer.period_s = seconds(period_ns_);
  answer.received_ns = pose.time_ns + age_ns_;
  const Vector3& tool_m = pose.pose.position_m;
  const bool contact = tool_m.y() > 0;
  ForceSample& sample = answer.sample;
  sample = shown_.answer(contact ? tool_m : Vector3(tool_m.x(), kForeseenM, tool_m.z()));
  sample.contact = contact;
  sample.foreseen = !contact;
  sample.sequence = ++sequence_;
  sample.pose_time_s = seconds(pose.time_ns);
  return answer;
}

std::optional<ServoAnswer> SpringAnswers::take(std::int64_t now_ns) {
  std::optional<ServoAnswer> newest;
  while (!on_the_way_.empty() && on_the_way_.front().received_ns <= now_ns) {
    newest = on_the_way_.front();
    on_the_way_.pop_front();
    if (!waits_ && newest->sample.sequence >= first_) ++arrived_;
  }
  if (newest) newest->received_ns = now_ns;
  return newest;
}

}  // namespace teletact::client
