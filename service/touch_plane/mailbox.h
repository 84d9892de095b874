// A mailbox of one slot: the newest value wins, a value that was not taken in time is gone. Not thread-safe.
#pragma once

#include <optional>
#include <utility>

namespace teletact::service {

template <class T>
class Mailbox {
 public:
  // Puts `value` in the slot, over an older one. Returns whether an older one was lost.
  bool put(T value) {
    const bool lost = slot_.has_value();
    slot_ = std::move(value);
    return lost;
  }
  std::optional<T> take() { return std::exchange(slot_, std::nullopt); }
  const std::optional<T>& newest() const { return slot_; }

 private:
  std::optional<T> slot_;
};

}  // namespace teletact::service
