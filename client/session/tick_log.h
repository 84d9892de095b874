// What of the servo's ticks is worth a message to a person: its states, and the beginnings and ends of what
// takes force away or trust from it, of a clutch, and whether it is a contact law's.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "client/servo/servo_loop.h"

namespace teletact::client {

struct LogMessage {
  bool warning = false;
  std::string text;
};

class TickLog {
 public:
  // Between messages of one kind, DEGRADED or fading: on a jittery link they come and go several times a
  // second.
  static constexpr double kEveryS = 1;

  // Between the same message about the contact law: a finger that crosses the borders of windows leaves it
  // and finds it again all the while.
  static constexpr double kLawEveryS = 5;

  // The messages that are due at this tick, with their reason; mostly none.
  std::vector<LogMessage> add(const ServoTick& tick);

 private:
  struct Spell {
    bool on = false;
    bool logged = false;  // this spell has had its first message, so its end is said too
    double begin_s = 0;
    double logged_s = -kEveryS;
    std::uint64_t left_out = 0;  // spells since the last message
  };
  using What = std::string (*)(const ServoTick&);  // its name up to the first comma, then the reason
  static void follow(Spell& spell, bool on, const ServoTick& tick, What what,
                     std::vector<LogMessage>& messages, bool warning = true);

  void follow_law(const ServoTick& tick, std::vector<LogMessage>& messages);

  bool started_ = false;
  bool by_law_ = false;                              // as it was said last
  double by_law_s_[2] = {-kLawEveryS, -kLawEveryS};  // when each of both was
  double refused_s_ = -kEveryS;
  ServoTick last_;
  Spell degraded_, service_degraded_, faded_, clutched_;
};

}  // namespace teletact::client
