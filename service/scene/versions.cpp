#include "service/scene/versions.h"

#include <algorithm>
#include <utility>

#include "service/scene/errors.h"
#include "service/scene/state_store.h"

namespace teletact::service {

VersionCounter::VersionCounter(StateStore* store, std::function<void()> used_up)
    : store_(store),
      used_up_(std::move(used_up)),
      next_(store ? store->first_version() : 1),
      reserved_(store ? store->reserved_versions() : UINT64_MAX) {}

std::uint64_t VersionCounter::next() {
  {
    const std::lock_guard lock(mutex_);
    if (next_ < reserved_) return next_++;
  }
  if (used_up_) used_up_();
  throw Error(
      ErrorKind::kExhausted,
      "state: the versions reserved on disk are used up; free disk space in the folder of --state, and "
      "send it again");
}

void VersionCounter::used(std::uint64_t version) {
  {
    const std::lock_guard lock(mutex_);
    next_ = std::max(next_, version + 1);
    if (version < reserved_) return;
  }
  reserve(version + 1 + StateStore::kVersionBlock);
}

void VersionCounter::reserve_ahead() {
  std::uint64_t limit = 0;
  {
    const std::lock_guard lock(mutex_);
    if (!store_ || reserved_ - next_ > StateStore::kVersionBlock / 2) return;
    limit = reserved_ + StateStore::kVersionBlock;
  }
  reserve(limit);
}

void VersionCounter::reserve(std::uint64_t limit) {
  const std::lock_guard writing(writing_);
  {
    const std::lock_guard lock(mutex_);
    if (limit <= reserved_) return;
  }
  store_->reserve_versions(limit);
  const std::lock_guard lock(mutex_);
  reserved_ = std::max(reserved_, limit);
}

}  // namespace teletact::service
