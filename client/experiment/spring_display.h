// A spring below y = 0 on a haptic device, or an inclusion of it in a background, for a person to feel,
// through the servo loop and its whole safety chain: perfect stiffness, with nothing to wait for, or the
// whole chain, the Kalman filter told of the spring as seldom and as late as a service tells. What is next
// is shown once the finger has been lifted: force is paused and comes back, with its start ramp, when the
// finger is out of contact and the renderer knows.
#pragma once

#include <atomic>
#include <memory>
#include <mutex>
#include <optional>
#include <string>
#include <thread>

#include "client/experiment/spring_answers.h"
#include "client/experiment/stimulus_display.h"
#include "client/experiment/trials.h"
#include "client/haptic/haptic_device.h"
#include "client/haptic/latest_slot.h"
#include "client/servo/servo_thread.h"

namespace teletact::client {

// What lies between a stimulus and who feels it; none of it: perfect stiffness. As the simulated observers
// have it (teletact-bench paper psychometric).
struct SpringChain {
  double update_hz = 100;  // answers
  double age_s = 0.005;    // of an answer as it comes
};

// Where the stimulus is felt: everywhere, or in an inclusion about kInclusionCentreM, with the background
// beside it.
struct SpringPlace {
  double width_m = 0;  // 0: everywhere
  double edge_m = 0.0015;
};
constexpr double kInclusionCentreM = 0.03;  // to the right of where the device starts

// A trial's: "perfect", or such as "kalman at 100 Hz 5 ms late on an inclusion of 20 mm with edges of 1.5
// mm".
std::string condition_of(const std::optional<SpringChain>&, const SpringPlace& place = {});

// Throws std::invalid_argument naming the field: update_hz outside 1 to 1000, age_s outside 0 to 0.3; width_m
// neither 0 nor 0.01 to 0.05, edge_m outside 0.0005 to 0.005.
void validate(const SpringChain&);
void validate(const SpringPlace&);

// Throws std::invalid_argument when a device of that profile cannot show so much: it would be felt softer
// than it is.
void require_shown(const DeviceProfile&, double stiffness_n_m);

// Renders the tissue that it was told of last as it is.
class PerfectRenderer final : public Renderer {
 public:
  void set_tissue(const SpringTissue& tissue) noexcept {
    newest_.put(tissue);
  }  // one thread; taken with the next answer
  void reset() noexcept override {}
  bool update(const ForceSample&, const ToolPose&, double) noexcept override {
    newest_.take(tissue_);
    return true;
  }
  using Renderer::render;
  Rendered render(const ToolPose& pose, double time_s, EnergyLedger&) noexcept override;

 private:
  LatestSlot<SpringTissue> newest_;
  SpringTissue tissue_;
};

class SpringDisplay final : public StimulusDisplay {
 public:
  // Opens the device, which outlives this. Throws as its open() and as validate().
  SpringDisplay(HapticDevice& device, bool real_time, const std::optional<SpringChain>& chain = {},
                const SpringPlace& place = {});
  ~SpringDisplay() override;
  SpringDisplay(const SpringDisplay&) = delete;
  SpringDisplay& operator=(const SpringDisplay&) = delete;

  // Throws as require_shown().
  void require(double stiffness_n_m) const { require_shown(device_.profile(), stiffness_n_m); }
  void present(double stiffness_n_m) { present(stiffness_n_m, stiffness_n_m); }
  void present(double stiffness_n_m, double background_n_m) override;
  bool has_inclusion() const noexcept override { return place_.width_m > 0; }
  bool felt() const noexcept override;
  double felt_n_m() const override;
  std::string trouble() const override;
  void ask_for_force() noexcept override { asked_ = true; }

 private:
  void answer_poses();
  void drain();

  HapticDevice& device_;
  const OpenDevice open_;
  const SpringPlace place_;
  PerfectRenderer perfect_;
  const std::unique_ptr<Renderer> renderer_;  // of the chain; none: perfect
  MonotonicClock clock_;
  std::unique_ptr<ServoLoop> servo_;
  mutable std::mutex mutex_;  // of the answers and what was felt, between who presents and who answers
  SpringAnswers answers_;
  FeltTicks felt_;
  std::atomic<ServoState> state_{ServoState::kDisabled};
  std::atomic<StateReason> reason_{StateReason::kStart};
  std::atomic<bool> asked_{false};
  std::atomic<bool> stop_{false};
  std::unique_ptr<ServoThread> thread_;  // ended first
  std::thread answering_;                // in the place of a link
};

}  // namespace teletact::client
