#include "service/imaging/engines.h"

#include <algorithm>
#include <iterator>

namespace teletact::service {

Engines::Borrowed Engines::borrow(const std::string& client) {
  std::unique_ptr<Elastography> engine;
  std::shared_ptr<Device> device;
  {
    const std::lock_guard lock(mutex_);
    device = device_;
    auto found = std::find_if(idle_.begin(), idle_.end(), [&](const Idle& i) { return i.client == client; });
    if (found == idle_.end() && !idle_.empty()) found = std::prev(idle_.end());
    if (found != idle_.end()) {
      engine = std::move(found->engine);
      idle_.erase(found);
    }
  }
  if (!engine) engine = std::make_unique<Elastography>(device);
  return {engine.release(), [this, client, device](Elastography* e) {
            give_back(client, device, std::unique_ptr<Elastography>(e));
          }};
}

void Engines::use(std::shared_ptr<Device> device) {
  std::list<Idle> old;
  const std::lock_guard lock(mutex_);
  device_ = std::move(device);
  old.swap(idle_);
}

void Engines::give_back(const std::string& client, const std::shared_ptr<Device>& device,
                        std::unique_ptr<Elastography> engine) {
  const std::lock_guard lock(mutex_);
  if (device != device_) return;
  idle_.push_front({client, std::move(engine)});
  if (idle_.size() > kMostIdle) idle_.pop_back();
}

}  // namespace teletact::service
