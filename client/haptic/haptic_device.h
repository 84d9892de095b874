// The one small interface to a haptic device. read() and write() are called from the servo thread at 1 kHz:
// they neither allocate nor throw. Axes are the scene's: x lateral, y into the tissue, z elevational; 1:1
// with the device's travel, unless a workspace map lies between (workspace.h).
#pragma once

#include <cstddef>
#include <cstdint>
#include <optional>
#include <span>
#include <string>

#include "client/haptic/profiles.h"
#include "client/haptic/region.h"
#include "client/render/renderer.h"

namespace teletact::client {

struct DeviceReading {
  ToolPose pose;
  // Of the hand while it is clutched: the way in all that the pose has not gone with it, and its velocity.
  ToolPose unseen = {};
  bool velocity_stated = false;                     // by the device, and not derived from its positions
  std::optional<Eigen::Vector4d> orientation = {};  // of its tool, a unit quaternion, where it states one
  bool frozen = false;          // its position is not of now, whatever comes of it (freshness_watch.h)
  bool clutched = false;        // the hand moves, the pose stands still
  std::uint32_t buttons = 0;    // that are down: bit 0 is button 1
  bool resume_pressed = false;  // the operator asks for force (a button)
  bool held_at_border = false;  // the operator waits at the border of what is covered
};

// What the operator is shown at each tick. A device with a screen may draw it; the simulated hand looks at
// it.
struct OperatorView {
  bool force_on = false;    // state ENABLED
  bool link_alive = false;  // answers arrive
  bool covered = false;     // the finger is over something that can be touched
  Region region = {};       // that is covered around it
  TouchedSurface surface = {};
};

// What a tactile display shows: [z][x], of square taxels.
struct TaxelView {
  std::size_t along_x = 0, along_z = 0;
  double pitch_m = 0;
  std::span<const float> pressure_pa, beyond_pa;  // beyond_pa empty: not known
};

class HapticDevice {
 public:
  virtual ~HapticDevice() = default;
  virtual const DeviceProfile& profile() const noexcept = 0;
  // Throws std::runtime_error, naming the device, when it cannot be opened.
  virtual void open() = 0;
  virtual void close() noexcept = 0;
  // False: the device did not answer.
  virtual bool read(std::int64_t now_ns, DeviceReading& reading) noexcept = 0;
  // Newtons on the finger; false: the device did not take it.
  virtual bool write(const Vector3& force_n) noexcept = 0;
  virtual void show(const OperatorView&) noexcept {}
  // From the thread that opens and closes; it does not wait.
  virtual void show_taxels(const TaxelView&) noexcept {}
  // Takes the force away for good: until open() no write is taken any more. From any thread, and from a
  // signal handler while the process dies: async-signal-safe. A device that no hand feels needs none.
  virtual void let_go() noexcept {}
  // The rest from any thread. The longest that a call of an adapter has taken since this was asked last.
  virtual double longest_call_s() noexcept { return 0; }
  // What a person should know of the device by now, in one line; empty: nothing new. From the thread that
  // opens and closes.
  virtual std::string trouble() { return ""; }
  // The middle of its workspace where read() has its positions, once that is known. From read()'s thread.
  virtual std::optional<Vector3> workspace_centre_m() const noexcept { return std::nullopt; }
  // Sweeps ended, of a device whose hand is simulated; and no more motion to come.
  virtual unsigned passes() const noexcept { return 0; }
  virtual bool ended() const noexcept { return false; }
};

}  // namespace teletact::client
