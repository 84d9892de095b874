// A spring below y = 0 on a haptic device, for a person to feel: perfect stiffness, through the servo loop
// and its whole safety chain but with nothing to wait for. What is next is shown once the finger has been
// lifted: force is paused and comes back, with its start ramp, as soon as the finger is out of contact.
#pragma once

#include <atomic>
#include <memory>
#include <string>
#include <thread>

#include "client/haptic/haptic_device.h"
#include "client/servo/servo_thread.h"

namespace teletact::client {

// The spring as a renderer: of the stiffness that was set last before the finger was lifted.
class SpringRenderer final : public Renderer {
 public:
  void set(double stiffness_n_m) noexcept { wanted_n_m_ = stiffness_n_m; }  // any thread
  double wanted_n_m() const noexcept { return wanted_n_m_; }
  void reset() noexcept override {}
  bool update(const ForceSample&, const ToolPose&, double) noexcept override { return true; }
  using Renderer::render;
  Rendered render(const ToolPose& pose, double time_s, double dissipated_j) noexcept override;

 private:
  std::atomic<double> wanted_n_m_{0};
  double shown_n_m_ = 0;
};

class SpringDisplay {
 public:
  static constexpr double kPressedM = 0.0005;  // pressed: deeper than this
  static constexpr double kFeltS = 0.3;        // felt: pressed for so long with the whole force on

  // Opens the device, which outlives this. Throws as its open().
  SpringDisplay(HapticDevice& device, bool real_time);
  ~SpringDisplay();
  SpringDisplay(const SpringDisplay&) = delete;
  SpringDisplay& operator=(const SpringDisplay&) = delete;

  // Throws std::invalid_argument when the device cannot show so much: it would be felt softer than it is.
  void require(double stiffness_n_m) const;
  // Throws as require().
  void present(double stiffness_n_m);
  // What was presented last has been felt.
  bool felt() const noexcept;
  // Why there is no force now; empty while there is.
  std::string trouble() const;
  // After a fault force comes back only for this: when the finger is out of contact.
  void ask_for_force() noexcept { asked_ = true; }

 private:
  void answer_poses();
  void drain();

  HapticDevice& device_;
  const OpenDevice open_;
  SpringRenderer renderer_;
  MonotonicClock clock_;
  std::unique_ptr<ServoLoop> servo_;
  std::atomic<unsigned> felt_ticks_{0};
  std::atomic<ServoState> state_{ServoState::kDisabled};
  std::atomic<StateReason> reason_{StateReason::kStart};
  std::atomic<bool> asked_{false};
  std::atomic<bool> stop_{false};
  std::unique_ptr<ServoThread> thread_;  // ended first
  std::thread answering_;                // in the place of a link: keeps the servo's answers young
};

}  // namespace teletact::client
