// Long work looks up now and then: whether it is to end, or to let others have their turn. Who wants to be
// asked puts a Looking on the thread; on a thread without one (a touch stream's) a look does nothing.
#pragma once

#include <algorithm>
#include <cstddef>
#include <functional>
#include <vector>

namespace teletact::service {

// Called by every look() of the thread while it lives, before those put there earlier. It may wait; what it
// throws ends the work.
class Looking {
 public:
  explicit Looking(std::function<void()>);
  ~Looking();
  Looking(const Looking&) = delete;
  Looking& operator=(const Looking&) = delete;

 private:
  friend void look();
  const std::function<void()> look_;
  const Looking* const before_;
};

// At most 50 ms of work lie between two looks, but where documented.
void look();
// Whether somebody looks on this thread.
bool looked_after();

// Items are added up to `size`, a million at once: the first touch of fresh memory takes as long as to fill
// it.
template <class T>
void grow(std::vector<T>& items, std::size_t size, const T& value = {}) {
  constexpr std::size_t kAtOnce = std::size_t{1} << 20;
  items.reserve(size);
  while (items.size() < size) {
    look();
    items.resize(std::min(size, items.size() + kAtOnce), value);
  }
}

// Seconds that the thread's looks have waited; a limit of time for the work leaves them out.
double waited_s();
void add_waited(double seconds);

}  // namespace teletact::service
