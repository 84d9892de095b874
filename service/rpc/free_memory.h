// Gives memory that is free back to the system: after a flood of calls the allocator keeps what they had, in
// the holes between blocks, and nobody else on the machine can use it.
#pragma once

#include <chrono>
#include <cstddef>
#include <thread>

namespace teletact::service {

// Of this process.
std::size_t resident_bytes_now();

class FreeMemory {
 public:
  static constexpr std::size_t kMinBytes = std::size_t{64} << 20;
  static constexpr std::chrono::seconds kLook{10};

  explicit FreeMemory(std::chrono::milliseconds between = kLook);

 private:
  void look();
  std::size_t unused_bytes_ = 0;  // after it gave back last, or the fewest since
  std::jthread thread_;
};

}  // namespace teletact::service
