// What a session of touching waits for, said in messages to a person: nothing may stand still in silence.
#pragma once

#include <string>

#include "client/servo/states.h"

namespace teletact::client {

struct TouchSituation {
  std::string trouble = {};  // why no stream is open; empty while one is
  ServoState state = ServoState::kDisabled;
  bool device_ok = true;  // it could be read and written
  bool covered = true;    // the last answer's: a window covers the finger
  bool held_at_border = false;
  double x_m = 0;         // of the finger
  double width_m = 0;     // of the tissue; 0: not known
  bool has_keys = false;  // Enter resumes
};

class Waiting {
 public:
  static constexpr double kTroubleS = 5;  // from message to message without a stream
  static constexpr double kRepeatS = 30;  // from message to message of what a person can change

  // Stands still for `first_s` before the first message.
  explicit Waiting(double first_s = 3) : first_s_(first_s) {}
  // The message that is due at `now_s` (any clock that only goes forward); mostly empty.
  std::string message(const TouchSituation& situation, double now_s);

 private:
  enum class For { kNothing, kStream, kDevice, kButton, kTissue, kWindow };
  static For waited_for(const TouchSituation& situation);

  const double first_s_;
  For for_ = For::kNothing;
  double due_s_ = 0;
};

}  // namespace teletact::client
