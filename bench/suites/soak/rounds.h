// What a soak compares: minutes in three parts. Others image; nobody does; nobody does and every core has
// other work to do, at the priority of the service's imaging. Beside the last, what imaging costs a touch is
// told from what any busy core costs it.
#pragma once

#include <atomic>
#include <thread>
#include <vector>

#include "bench/suites/soak/soak.h"

namespace teletact::bench::soak {

enum class Part { kImaging, kIdle, kBusyCores };

constexpr double kRoundS = 60;
// Of a soak that began `time_s` ago.
Part part_at(double time_s);

// Until it goes out of scope: pauses imaging and keeps cores busy, each in its part of a round.
class Rounds {
 public:
  explicit Rounds(Pause&);
  ~Rounds();

 private:
  void keep_busy() const;
  std::atomic<bool> stop_{false}, busy_{false};
  std::vector<std::thread> threads_;
};

}  // namespace teletact::bench::soak
