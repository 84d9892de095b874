// What stands between a hand and a tissue in a trial: a device's sensor, the renderer with or without the
// servo loop about it, and the answers that are on their way.
#pragma once

#include <array>
#include <memory>
#include <string>

#include "bench/stability/tissue.h"
#include "client/haptic/profiles.h"
#include "client/haptic/quantised_reading.h"
#include "client/servo/servo_loop.h"

namespace teletact::bench {

using client::Vector3;

inline constexpr std::size_t kLongestDelayTicks = 1024;

struct RigOptions {
  std::string renderer = "kalman";
  client::DeviceProfile profile;
  double update_s = 0.02;    // between answers
  double model_delay_s = 0;  // from a pose to its answer
  bool foreseen = true;      // answers out of contact tell what waits below the finger
  double asks_until_s = 0;   // the button is pressed and released so long
  double stall_s = 0;        // nothing arrives for so long, every ten times that
  bool safe = true;          // through the servo loop with its whole safety chain
};

// What a controller knows of the plant: quantised as a simulated device; an ideal display is read exactly.
class Sensor {
 public:
  Sensor(double resolution_m, const Vector3& start_m);
  client::ToolPose read(const client::ToolPose& exact) noexcept;

 private:
  bool exact_;
  client::QuantisedReading reading_;
};

// A renderer as it is, or in the servo loop with its safety chain.
class Controller {
 public:
  explicit Controller(const RigOptions& options);
  ~Controller();
  // The force on the finger from now on; `answer`, if not null, has just come in.
  Vector3 tick(const client::ToolPose& pose, const client::ForceSample* answer, double time_s) noexcept;
  // Arrives at the next tick.
  void take_law(const client::NearLaw& law) noexcept;
  const client::ServoTick& last() const noexcept { return last_; }

 private:
  class Device;
  static constexpr double kStartS = 1;  // the manual clock's
  RigOptions options_;
  std::unique_ptr<client::Renderer> renderer_;
  std::unique_ptr<Device> device_;
  client::ManualClock clock_;
  std::unique_ptr<client::ServoLoop> loop_;
  client::ServoTick last_;
};

// Poses that are on their way to becoming answers, in order.
class Answers {
 public:
  Answers(const StabilityTissue& tissue, const RigOptions& options);
  // The answer that arrives at this tick, if one does.
  const client::ForceSample* at(std::size_t tick, const client::ToolPose& pose);
  const client::ForceSample& newest() const { return newest_; }
  // Poses are answered with it from now on.
  void is(const StabilityTissue& tissue, std::uint64_t version) { tissue_ = &tissue, version_ = version; }

 private:
  const StabilityTissue* tissue_;
  std::uint64_t version_ = 1;
  std::size_t every_, late_, stall_;
  bool foreseen_;
  std::array<client::ForceSample, kLongestDelayTicks> waiting_;
  std::size_t asked_ = 0, given_ = 0;
  client::ForceSample newest_;
};

}  // namespace teletact::bench
