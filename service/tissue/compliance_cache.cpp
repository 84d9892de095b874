#include "service/tissue/compliance_cache.h"

#include <algorithm>
#include <iterator>

namespace teletact::service {

ComplianceCache::ComplianceCache(std::size_t rows, std::size_t max_kept,
                                 std::function<void(std::size_t)> forget)
    : max_(std::max<std::size_t>(1, max_kept)), forget_(std::move(forget)), rows_(rows) {}

std::shared_ptr<Compliance> ComplianceCache::get(std::size_t row,
                                                 const std::function<std::shared_ptr<Compliance>()>& make) {
  const std::lock_guard lock(rows_[row].making);
  std::shared_ptr<Compliance> made = rows_[row].made.lock();
  if (!made) rows_[row].made = made = make();
  keep(row, made);
  return made;
}

std::shared_ptr<Compliance> ComplianceCache::find(std::size_t row) {
  const std::lock_guard lock(mutex_);
  const auto found =
      std::find_if(kept_.begin(), kept_.end(), [row](const auto& one) { return one.first == row; });
  if (found == kept_.end()) return nullptr;
  used_ = use_stamp();
  return found->second;
}

void ComplianceCache::keep(std::size_t row, const std::shared_ptr<Compliance>& made) {
  const std::lock_guard lock(mutex_);
  std::erase_if(kept_, [row](const auto& other) { return other.first == row; });
  kept_.insert(kept_.begin(), {row, made});
  used_ = use_stamp();
  if (kept_.size() > max_) drop(std::prev(kept_.end()));
}

void ComplianceCache::drop(Kept::iterator at) {
  forget_(at->first);
  kept_.erase(at);
}

bool ComplianceCache::give_back() {
  const std::unique_lock lock(mutex_, std::try_to_lock);
  if (!lock) return false;
  const auto unheld =
      std::find_if(kept_.rbegin(), kept_.rend(), [](const auto& one) { return one.second.use_count() == 1; });
  if (unheld == kept_.rend()) return false;
  drop(std::prev(unheld.base()));
  return true;
}

}  // namespace teletact::service
