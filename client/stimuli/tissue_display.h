// Tissue on a service for an observer to feel: each stimulus a scene, through the touch stream, its law or
// renderer, the safety chain and the servo. What is presented next has a stream, a renderer and a servo loop
// of its own; the device stays open. Nothing changes under a pressed finger: the force slews to zero, and
// comes back, with its start ramp, once the finger is out of contact and answers flow.
//
// An interval whose stream ended, or that has none after kOpenS, is lost, even where the stream comes back:
// what was felt of it is not known to be all of it.
#pragma once

#include <atomic>
#include <memory>
#include <mutex>
#include <string>
#include <thread>

#include "client/experiment/stimulus_display.h"
#include "client/haptic/haptic_device.h"
#include "client/link/touch_link.h"
#include "client/render/renderer.h"
#include "client/servo/open_device.h"
#include "client/servo/servo_thread.h"
#include "client/stimuli/stimulus_scenes.h"

namespace teletact::client {

class TissueDisplay final : public StimulusDisplay {
 public:
  static constexpr double kOpenS = 10;  // for a stream

  // Opens the device. Borrows both. `renderer`: as renderers.h names those of touch. Throws as the device's
  // open() and make_renderer().
  TissueDisplay(HapticDevice& device, StimulusScenes& scenes, std::string renderer, bool real_time);
  ~TissueDisplay() override;
  TissueDisplay(const TissueDisplay&) = delete;
  TissueDisplay& operator=(const TissueDisplay&) = delete;

  // Throws as StimulusScenes::make_sure(), where the interval before was lost, and as scene_of().
  void present(double stiffness_n_m, double background_n_m) override;
  bool has_inclusion() const noexcept override { return scenes_.options().place.width_m > 0; }
  bool felt() const noexcept override;
  double felt_n_m() const override;
  std::string trouble() const override;
  void ask_for_force() noexcept override { asked_ = true; }
  std::string lost() const override;

 private:
  struct Interval;
  void watch();
  void look(Interval&);
  void count(const ServoTick&);
  void ask_for_resume(ServoLoop&);

  HapticDevice& device_;
  StimulusScenes& scenes_;
  const std::string renderer_;
  const bool real_time_;
  const OpenDevice open_;
  MonotonicClock clock_;
  mutable std::mutex mutex_;            // everything below but the threads and what is atomic
  std::unique_ptr<Interval> interval_;  // what is felt now
  FeltTicks felt_;
  ServoTick newest_;
  std::int64_t answered_ns_ = 0;  // the first tick with an answer; 0: none yet
  std::int64_t enabled_ns_ = 0;   // since when force has been on; 0: it is not
  std::string lost_;
  bool after_fault_ = false;  // force comes back only when it is asked for
  std::atomic<bool> asked_{false};
  std::atomic<bool> stop_{false};
  std::thread watching_;
};

}  // namespace teletact::client
