// Independent trials on all cores: results are kept by their number, so they do not depend on how many.
#pragma once

#include <atomic>
#include <cstddef>
#include <thread>
#include <vector>

namespace teletact::bench {

// do_one(n) for every n < count; it must not throw.
template <typename Function>
void in_parallel(std::size_t count, const Function& do_one) {
  std::atomic<std::size_t> next{0};
  const auto work = [&] {
    for (std::size_t n = next++; n < count; n = next++) do_one(n);
  };
  std::vector<std::jthread> threads;
  for (unsigned k = 1; k < std::thread::hardware_concurrency(); ++k) threads.emplace_back(work);
  work();
}

}  // namespace teletact::bench
