// What a service would answer of tissue below y = 0: at its rate, as late as it is, and out of contact what
// waits there. No thread and no clock: time is an argument.
#pragma once

#include <cstdint>
#include <deque>
#include <optional>

#include "client/experiment/spring_tissue.h"
#include "client/servo/servo_loop.h"

namespace teletact::client {

class SpringAnswers {
 public:
  // A pose is answered every `period_s`, and the answer is there `age_s` after its pose.
  SpringAnswers(double period_s, double age_s);

  // From the first pose on whose finger is lifted: nothing changes under a pressed one.
  void present(const SpringTissue& tissue);
  // Poses in order, as often as they can be had; those that are due are answered.
  void add(const ServoPose& pose);
  // The newest answer that has come since the last call.
  std::optional<ServoAnswer> take(std::int64_t now_ns);

  const SpringTissue& shown() const noexcept { return shown_; }
  // Answers that have come of what was presented last.
  unsigned arrived() const noexcept { return arrived_; }
  // The answer of that sequence, and so what is felt of it, is of what was presented last.
  bool is_presented(std::uint64_t sequence) const noexcept { return arrived_ > 0 && sequence >= first_; }

 private:
  ServoAnswer answer_to(const ServoPose& pose);

  std::int64_t period_ns_, age_ns_;
  std::int64_t next_ns_ = 0;
  SpringTissue wanted_, shown_;
  bool waits_ = false;  // what was presented last is not shown yet
  std::uint64_t sequence_ = 0;
  std::uint64_t first_ = 0;  // sequence that was answered with what was presented last
  unsigned arrived_ = 0;
  std::deque<ServoAnswer> on_the_way_;
};

}  // namespace teletact::client
