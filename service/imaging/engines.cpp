#include "service/imaging/engines.h"

#include <algorithm>
#include <iterator>

namespace teletact::service {

// An engine until it is used again, or its room is needed.
class Engines::Idle final : public Reclaimable {
 public:
  Idle(std::string client, std::unique_ptr<Elastography> engine)
      : client_(std::move(client)), engine_(std::move(engine)) {}
  const std::string& client() const { return client_; }
  // Null once it was taken or given back.
  std::unique_ptr<Elastography> take() {
    const std::lock_guard lock(mutex_);
    return std::move(engine_);
  }
  std::uint64_t last_use() const override { return used_; }
  bool give_back() override { return take() != nullptr; }

 private:
  const std::string client_;
  const std::uint64_t used_ = use_stamp();
  std::mutex mutex_;
  std::unique_ptr<Elastography> engine_;
};

Engines::Engines(std::shared_ptr<Device> device, std::size_t most_idle)
    : most_idle_(most_idle), device_(std::move(device)) {}
Engines::~Engines() = default;

Engines::Borrowed Engines::borrow(const std::string& client) {
  std::unique_ptr<Elastography> engine;
  std::shared_ptr<Device> device;
  {
    const std::lock_guard lock(mutex_);
    device = device_;
    auto found =
        std::find_if(idle_.begin(), idle_.end(), [&](const auto& i) { return i->client() == client; });
    if (found == idle_.end() && !idle_.empty()) found = std::prev(idle_.end());
    if (found != idle_.end()) {
      engine = (*found)->take();
      idle_.erase(found);
    }
  }
  if (!engine) engine = std::make_unique<Elastography>(device);
  return {engine.release(), [this, client, device](Elastography* e) {
            give_back(client, device, std::unique_ptr<Elastography>(e));
          }};
}

void Engines::use(std::shared_ptr<Device> device) {
  std::list<std::shared_ptr<Idle>> old;
  const std::lock_guard lock(mutex_);
  device_ = std::move(device);
  old.swap(idle_);
}

void Engines::give_back(const std::string& client, const std::shared_ptr<Device>& device,
                        std::unique_ptr<Elastography> engine) {
  const MemoryAccount account = engine->account();
  std::shared_ptr<Idle> one_more;  // gone without the lock
  const std::lock_guard lock(mutex_);
  if (device != device_) return;
  idle_.push_front(std::make_shared<Idle>(client, std::move(engine)));
  account.add(device->place(), idle_.front());
  if (idle_.size() <= most_idle_) return;
  one_more = std::move(idle_.back());
  idle_.pop_back();
}

}  // namespace teletact::service
