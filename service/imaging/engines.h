// Elastography engines for estimates that are under way at once. An engine keeps its buffers for the next
// pair of the same client; more than `most_idle` do not outlive their use, and idle ones go when others need
// the device's memory.
#pragma once

#include <functional>
#include <list>
#include <memory>
#include <mutex>
#include <string>

#include "service/imaging/estimate.h"

namespace teletact::service {

class Engines {
 public:
  explicit Engines(std::shared_ptr<Device>, std::size_t most_idle = 2);
  ~Engines();

  using Borrowed = std::unique_ptr<Elastography, std::function<void(Elastography*)>>;
  // The one that the client used last, another that is idle, or a new one. Thread-safe. Throws DeviceError.
  Borrowed borrow(const std::string& client);
  // From now on: those of the device before go when they are given back. Thread-safe.
  void use(std::shared_ptr<Device>);

 private:
  class Idle;
  void give_back(const std::string& client, const std::shared_ptr<Device>&, std::unique_ptr<Elastography>);
  const std::size_t most_idle_;
  std::mutex mutex_;
  std::shared_ptr<Device> device_;
  std::list<std::shared_ptr<Idle>> idle_;  // used last first
};

}  // namespace teletact::service
