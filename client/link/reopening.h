// How soon a touch stream is opened again, or a service that moves is followed again: what broke at once,
// what was refused or moves again and again ever more seldom, until a stream has lived for a while.
//
// Pure: time is an argument. One thread.
#pragma once

#include "client/link/retry.h"

namespace teletact::client {

class Reopening {
 public:
  static constexpr double kRetryS = 0.1;      // from a stream's end to the next
  static constexpr double kMaxRetryS = 5.0;  // when it is refused again and again
  static constexpr double kSettledS = 5.0;    // a stream that lived for so long

  // After a stream that has ended. `lived_s`: since it was opened; 0: it never was.
  double after_end_s(bool refused, double lived_s) { return refused ? next_s(refused_, lived_s) : kRetryS; }
  // After a stream whose service moved, since it was left.
  double after_move_s(double lived_s) { return next_s(moves_, lived_s); }

 private:
  static double next_s(Backoff& backoff, double lived_s) {
    if (lived_s > kSettledS) backoff.restart();
    return backoff.next_s();
  }
  Backoff refused_{kRetryS, kMaxRetryS}, moves_{kRetryS, kMaxRetryS};
};

}  // namespace teletact::client
