#include "client/acquire/prepared_source.h"

#include <mutex>
#include <stdexcept>
#include <utility>

#include "client/patient/parallel.h"

namespace teletact::client {

void PreparedSource::prepare(std::size_t windows, std::size_t passes, const Progress& progress,
                             const std::function<std::vector<FramePair>(std::size_t window)>& passes_of,
                             unsigned threads) {
  if (windows == 0) throw std::invalid_argument("the tissue is narrower than the probe");
  if (passes == 0) throw std::invalid_argument("at least one pass must be prepared");
  windows_.resize(windows);
  std::mutex mutex;  // guards `done`
  std::size_t done = 0;
  in_parallel(
      windows,
      [&](std::size_t k) {
        windows_[k].passes = passes_of(k);
        const std::lock_guard lock(mutex);
        ++done;
        if (progress) progress(done, windows);
      },
      threads);
}

std::size_t PreparedSource::frames_left(std::size_t window) const {
  const Window& w = windows_.at(window);
  return w.passes.size() - w.taken;
}

FramePair PreparedSource::take(std::size_t window) {
  Window& w = windows_.at(window);
  if (w.taken == w.passes.size()) throw std::out_of_range("every prepared pass of this window is used up");
  return std::move(w.passes[w.taken++]);
}

}  // namespace teletact::client
