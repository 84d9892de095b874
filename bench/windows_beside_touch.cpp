#include "bench/windows_beside_touch.h"

#include <atomic>
#include <chrono>
#include <cmath>
#include <mutex>
#include <thread>
#include <utility>

#include "bench/basics/clock.h"
#include "service/contact/contact.h"
#include "service/tissue/tissue_model.h"

namespace teletact::bench {
namespace {

// A finger that slides over a condensed surface and is answered kRateHz times a second, on a thread of its
// own.
class Finger {
 public:
  explicit Finger(reference::TouchedTissue tissue)
      : tissue_(std::move(tissue)), model_(tissue_.grid, tissue_.material, tissue_.supports, {}) {
    compliance_ = model_.compliance(0);
    thread_ = std::thread([this] { slide(); });
  }
  ~Finger() { stop(); }
  // Seconds from when an answer was due to when it was there.
  const std::vector<double>& stop() {
    stopped_ = true;
    if (thread_.joinable()) thread_.join();
    return latency_s_;
  }

 private:
  static constexpr double kRateHz = 500;
  void slide() {
    const auto begin = Clock::now();
    for (int k = 0; !stopped_; ++k) {
      const auto due =
          begin + std::chrono::duration_cast<Clock::duration>(std::chrono::duration<double>(k / kRateHz));
      std::this_thread::sleep_until(due);
      const double x_m = 0.030 + 0.010 * std::sin(0.012 * k);
      service::solve_contact(model_.problem(), 0, *compliance_, {}, {x_m, 0.002});
      latency_s_.push_back(seconds_since(due));
    }
  }
  reference::TouchedTissue tissue_;
  service::TissueModel model_;
  std::shared_ptr<service::Compliance> compliance_;
  std::atomic<bool> stopped_{false};
  std::vector<double> latency_s_;
  std::thread thread_;
};

}  // namespace

WindowTimes windows_beside_touch(const std::vector<std::function<service::Estimate()>>& at_once, int windows,
                                 const std::optional<reference::TouchedTissue>& touched) {
  std::vector<double> displacement, strain, modulus, total;
  std::optional<Finger> finger;
  if (touched) finger.emplace(*touched);
  std::mutex mutex;
  const auto begin = Clock::now();
  {
    std::vector<std::jthread> threads;
    for (const auto& window : at_once)
      threads.emplace_back([&] {
        for (int k = 0; k < windows; ++k) {
          const auto asked = Clock::now();
          const service::Estimate e = window();
          const std::lock_guard lock(mutex);
          total.push_back(seconds_since(asked));
          displacement.push_back(e.displacement_s), strain.push_back(e.strain_s),
              modulus.push_back(e.modulus_s);
        }
      });
  }
  const double windows_s = static_cast<double>(total.size()) / seconds_since(begin);
  return {windows_s,          quantiles(displacement), quantiles(strain),
          quantiles(modulus), quantiles(total),        finger ? quantiles(finger->stop()) : Quantiles{}};
}

}  // namespace teletact::bench
