// Independent work on several threads: results are kept by their number, so they do not depend on how many.
#pragma once

#include <algorithm>
#include <atomic>
#include <cstddef>
#include <exception>
#include <mutex>
#include <thread>
#include <vector>

namespace teletact::client {

// do_one(n) for every n < count, on `threads` threads (0: one per processor), this one among them. Throws
// what one of them threw, once all have ended.
template <typename Function>
void in_parallel(std::size_t count, const Function& do_one, unsigned threads = 0) {
  std::atomic<std::size_t> next{0};
  std::mutex mutex;  // guards `failure`
  std::exception_ptr failure;
  const auto work = [&] {
    try {
      for (std::size_t n = next++; n < count; n = next++) do_one(n);
    } catch (...) {
      const std::lock_guard lock(mutex);
      failure = std::current_exception();
    }
  };
  {
    if (threads == 0) threads = std::max(1u, std::thread::hardware_concurrency());
    std::vector<std::jthread> others;
    for (unsigned k = 1; k < threads; ++k) others.emplace_back(work);
    work();
  }
  if (failure) std::rethrow_exception(failure);
}

}  // namespace teletact::client
