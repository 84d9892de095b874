// When poses are meant to be sent, whatever the service does.
#pragma once

#include <cstdint>
#include <random>

namespace teletact::bench {

struct Rate {
  double begin_hz = 0, end_hz = 0;  // rises, or falls, evenly over the duration
  double duration_s = 0;
  bool poisson = false;  // else evenly spaced
};

// Where in a period a client begins, 0 .. 1: spread evenly, however many they are.
double phase_of(unsigned client);

class Arrivals {
 public:
  // Of one client out of several: seeds, and phases of even spacing, differ. Throws std::invalid_argument: a
  // rate or duration that is not above 0.
  Arrivals(const Rate& rate, unsigned client, std::uint64_t seed);
  // The next instant, s since the begin, increasing; beyond duration_s there is none: infinity.
  double next();

 private:
  Rate rate_;
  std::mt19937_64 random_;
  double expected_;  // poses until the next one
};

}  // namespace teletact::bench
