// Memory that was in use for a while goes back to the system.
#include "service/rpc/free_memory.h"

#include <gtest/gtest.h>

#include <chrono>
#include <memory>
#include <thread>
#include <vector>

namespace teletact::service {
namespace {

// Where the sanitizer has an allocator of its own, there is nothing to give back.
#ifndef __SANITIZE_ADDRESS__
// The second half is in use when the first is given back.
TEST(FreeMemory, IsGivenBack) {
  constexpr std::size_t kBlocks = 150'000, kBlockBytes = 1024, kKept = 1000;
  std::vector<std::unique_ptr<char[]>> blocks(2 * kBlocks);
  for (auto& block : blocks) block = std::make_unique<char[]>(kBlockBytes);
  const FreeMemory keeper(std::chrono::milliseconds(20));
  for (const std::size_t begin : {std::size_t{0}, kBlocks}) {
    const std::size_t held = resident_bytes_now();
    for (std::size_t k = begin; k < begin + kBlocks; ++k)
      if (k % kKept != 0) blocks[k].reset();
    for (int k = 0; k < 1000 && resident_bytes_now() > held - kBlocks * kBlockBytes / 2; ++k)
      std::this_thread::sleep_for(std::chrono::milliseconds(10));
    EXPECT_LE(resident_bytes_now(), held - kBlocks * kBlockBytes / 2);
  }
}
#endif

}  // namespace
}  // namespace teletact::service
