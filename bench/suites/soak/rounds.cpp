#include "bench/suites/soak/rounds.h"

#include <sys/resource.h>
#include <unistd.h>

#include <algorithm>
#include <chrono>
#include <cmath>

#include "bench/basics/clock.h"

namespace teletact::bench::soak {
namespace {

constexpr double kImagingShare = 0.5, kIdleShare = 0.25;  // of a round; the rest: busy cores
constexpr int kNiceness = 10;                             // as the service's imaging
constexpr auto kLookEvery = std::chrono::milliseconds(10);

}  // namespace

Part part_at(double time_s) {
  const double share = std::fmod(time_s, kRoundS) / kRoundS;
  if (share < kImagingShare) return Part::kImaging;
  return share < kImagingShare + kIdleShare ? Part::kIdle : Part::kBusyCores;
}

Rounds::Rounds(Pause& pause) {
  threads_.emplace_back([this, &pause] {
    const auto begin = Clock::now();
    while (!stop_) {
      const Part part = part_at(seconds_since(begin));
      pause = part != Part::kImaging;
      busy_ = part == Part::kBusyCores;
      std::this_thread::sleep_for(kLookEvery);
    }
  });
  for (unsigned k = 0; k < std::max(1U, std::thread::hardware_concurrency()); ++k)
    threads_.emplace_back([this] { keep_busy(); });
}

Rounds::~Rounds() {
  stop_ = true;
  for (std::thread& thread : threads_) thread.join();
}

void Rounds::keep_busy() const {
  setpriority(PRIO_PROCESS, static_cast<id_t>(gettid()), kNiceness);  // Linux: of this thread
  while (!stop_) {
    if (!busy_) std::this_thread::sleep_for(kLookEvery);
  }
}

}  // namespace teletact::bench::soak
