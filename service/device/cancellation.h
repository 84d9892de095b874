// Long work looks up now and then: whether it is to end, or to let others have their turn. Who wants to be
// asked puts a CancellationCheck on the thread; on a thread without one (a touch stream's) a look does
// nothing.
#pragma once

#include <algorithm>
#include <chrono>
#include <cstddef>
#include <functional>
#include <vector>

namespace teletact::service {

// Called by every check_cancelled() of the thread while it lives, before those put there earlier. It may
// wait; what it throws ends the work.
class CancellationCheck {
 public:
  explicit CancellationCheck(std::function<void()>);
  ~CancellationCheck();
  CancellationCheck(const CancellationCheck&) = delete;
  CancellationCheck& operator=(const CancellationCheck&) = delete;

 private:
  friend void check_cancelled();
  const std::function<void()> look_;
  const CancellationCheck* const before_;
};

// At most 50 ms of work lie between two looks, but where documented.
void check_cancelled();
// Whether somebody looks on this thread.
bool is_cancellable();

// Items are added up to `size`, a million at once: the first touch of fresh memory takes as long as to fill
// it.
template <class T>
void grow(std::vector<T>& items, std::size_t size, const T& value = {}) {
  constexpr std::size_t kAtOnce = std::size_t{1} << 20;
  items.reserve(size);
  while (items.size() < size) {
    check_cancelled();
    items.resize(std::min(size, items.size() + kAtOnce), value);
  }
}

// Seconds that the thread's looks have waited; a limit of time for the work leaves them out.
double waited_s();
void add_waited(double seconds);

// Seconds of the thread's own work, from any moment: while its looks wait it stands still.
inline double worked_s() {
  return std::chrono::duration<double>(std::chrono::steady_clock::now().time_since_epoch()).count() -
         waited_s();
}

}  // namespace teletact::service
