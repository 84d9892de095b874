#include "service/contact/prepared_compliances.h"

#include <spdlog/spdlog.h>

#include <utility>

namespace teletact::service {

std::shared_ptr<Compliance> PreparedCompliances::get(std::size_t row, const std::shared_ptr<Device>& device,
                                                     const TouchWork& work, const std::string& client) {
  if (!device)
    if (auto made = model_->made(row)) return made;
  const Key key{row, device};
  if (!work) return make(key);
  {
    const std::lock_guard lock(mutex_);
    Entry& state = entries_[key];
    if (auto made = state.iterative.lock()) return made;
    if (state.asked.contains(client)) return nullptr;
    if (state.asked.empty() && state.error && Clock::now() < state.retry) std::rethrow_exception(state.error);
    state.asked.insert(client);
  }
  work(client, [self = shared_from_this(), key] { self->make_for_others(key); });
  return nullptr;
}

std::shared_ptr<Compliance> PreparedCompliances::make(const Key& key) const {
  return key.second ? model_->iterative(key.first, key.second) : model_->condensed(key.first);
}

void PreparedCompliances::make_for_others(const Key& key) {
  {
    const std::lock_guard lock(mutex_);
    if (entries_[key].asked.empty()) return;  // made in another's turn
  }
  std::shared_ptr<Compliance> made;
  std::exception_ptr error;
  try {
    made = make(key);
  } catch (const std::exception& e) {
    error = std::current_exception();
    spdlog::warn("event=layer_not_prepared row={} error=\"{}\"", key.first, e.what());
  }
  const std::lock_guard lock(mutex_);
  Entry& state = entries_[key];
  if (key.second) state.iterative = made;
  state.asked.clear();
  state.error = std::move(error);
  state.retry = Clock::now() + kRetry;
}

}  // namespace teletact::service
