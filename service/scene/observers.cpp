#include "service/scene/observers.h"

#include <utility>

namespace teletact::service {

// A stream without a name is looked at where it steers alone.
bool Observers::One::looks_at(const From& from) const {
  return options.session_id.empty() ? from.steers : options.session_id == from.session_id;
}

Observers::Id Observers::join(Options options) {
  const std::lock_guard lock(mutex_);
  all_.emplace(++last_, One{std::move(options), {}, {}});
  any_ = true;
  return last_;
}

void Observers::leave(Id id) {
  const std::lock_guard lock(mutex_);
  all_.erase(id);
  any_ = !all_.empty();
}

Observers::News Observers::take(Id id) {
  const std::lock_guard lock(mutex_);
  return std::exchange(all_.at(id).news, {});
}

Observers::Wanted Observers::wanted(const From& from) const {
  Wanted wanted;
  const std::lock_guard lock(mutex_);
  for (const auto& [id, one] : all_) {
    if (!one.looks_at(from)) continue;
    wanted.touch |= one.options.answers;
    wanted.surface |= one.options.surface;
  }
  return wanted;
}

void Observers::tell(const From& from, const std::shared_ptr<const ObservedTouch>& touch) {
  const std::lock_guard lock(mutex_);
  for (auto& [id, one] : all_)
    if (one.looks_at(from) && one.options.answers) one.news.touch = touch;
}

void Observers::tell(const From& from, const std::shared_ptr<const ObservedSurface>& surface) {
  const std::lock_guard lock(mutex_);
  for (auto& [id, one] : all_) {
    if (!one.looks_at(from) || !one.options.surface || surface->at < one.surface_at) continue;
    one.news.surface = surface;
    one.surface_at = surface->at;
  }
}

}  // namespace teletact::service
