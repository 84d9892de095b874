#include "service/tissue/line_cache.h"

#include <algorithm>
#include <iterator>

namespace teletact::service {

LineCache::LineCache(std::size_t lines, std::size_t most_kept, std::function<void(std::size_t)> forget)
    : most_(std::max<std::size_t>(1, most_kept)), forget_(std::move(forget)), lines_(lines) {}

std::shared_ptr<Compliance> LineCache::get(std::size_t line,
                                           const std::function<std::shared_ptr<Compliance>()>& make) {
  const std::lock_guard lock(lines_[line].making);
  std::shared_ptr<Compliance> made = lines_[line].made.lock();
  if (!made) lines_[line].made = made = make();
  keep(line, made);
  return made;
}

std::shared_ptr<Compliance> LineCache::find(std::size_t line) {
  const std::lock_guard lock(mutex_);
  const auto found =
      std::find_if(kept_.begin(), kept_.end(), [line](const auto& one) { return one.first == line; });
  if (found == kept_.end()) return nullptr;
  used_ = use_stamp();
  return found->second;
}

void LineCache::keep(std::size_t line, const std::shared_ptr<Compliance>& made) {
  const std::lock_guard lock(mutex_);
  std::erase_if(kept_, [line](const auto& other) { return other.first == line; });
  kept_.insert(kept_.begin(), {line, made});
  used_ = use_stamp();
  if (kept_.size() > most_) drop(std::prev(kept_.end()));
}

void LineCache::drop(Kept::iterator at) {
  forget_(at->first);
  kept_.erase(at);
}

bool LineCache::give_back() {
  const std::unique_lock lock(mutex_, std::try_to_lock);
  if (!lock) return false;
  const auto unheld =
      std::find_if(kept_.rbegin(), kept_.rend(), [](const auto& one) { return one.second.use_count() == 1; });
  if (unheld == kept_.rend()) return false;
  drop(std::prev(unheld.base()));
  return true;
}

}  // namespace teletact::service
