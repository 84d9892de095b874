// What a renderer is: from the service's answers, a few hundred a second, to a force at every servo tick.
// Pure and allocation-free: no clock, no thread, no gRPC; time is an argument.
#pragma once

#include <cstdint>
#include <limits>

#include "client/render/contact_frame.h"
#include "client/render/energy_ledger.h"
#include "client/render/near_law.h"

namespace teletact::client {

// The tool at one servo tick.
struct ToolPose {
  Vector3 position_m = Vector3::Zero();
  Vector3 velocity_m_s = Vector3::Zero();
};

// One answer of the service: a force and the pose that it was computed for (T5.4: kept paired).
struct ForceSample {
  std::uint64_t sequence = 0;             // of that pose
  std::uint64_t model_version = 0;        // that it was computed with
  std::uint32_t solved_by = 0;            // which model of that version gave it; 0: it is not said
  double pose_time_s = 0;                 // when that pose was sampled, servo clock
  Vector3 position_m = Vector3::Zero();   // that pose
  Vector3 force_n = Vector3::Zero();      // on the finger: against the normal for a push
  Matrix3 tangent_n_m = Matrix3::Zero();  // d force / d position
  TouchedSurface surface = {};            // undeformed
  double relative_error = 0;              // what the service says that the force may be off by, over it
  bool contact = false;                   // false: the finger was not in contact, force zero
  // Not in contact, but told what waits there: position, force and tangent are those of a light touch below
  // the finger. Feels like nothing; a model that knows it has its stiffness when the finger arrives.
  bool foreseen = false;
};

struct Rendered {
  Vector3 force_n = Vector3::Zero();  // on the finger
  double stiffness_n_m = 0;           // along the push: resistance over indentation
  // Both lateral components of the contact (ContactFrame): lateral force over indentation, the force's sign
  // turned as well. The second is zero in a plane scene, whose tissue gives no force across its plane.
  Vector2 lateral_stiffness_n_m = Vector2::Zero();
  // Mean square, (N/m)^2, of what each of these is off by at this pose and time: of the model, what it may
  // have changed by since its newest answer, and what is not blended in or withheld. The errors are
  // independent. Infinite while nothing is known.
  double variance = std::numeric_limits<double>::infinity();
  Vector2 lateral_variance = Vector2::Constant(std::numeric_limits<double>::infinity());
  // What the model that is felt would give back if the finger were lifted straight up from here. Where the
  // force is that of no model, what a spring of the rendered stiffness holds.
  double stored_j = 0;
  double gain = 0;      // of the last update: how much of the innovation was believed, 0 .. 1
  double withheld = 0;  // share of the model's stiffness that waits to be paid for, 0 .. 1
  bool by_law = false;  // a contact law is felt, or would be were the finger in contact
};

class Renderer {
 public:
  virtual ~Renderer() = default;
  virtual void reset() noexcept = 0;
  // A new answer, `pose` and `time_s` being those of this tick. Samples and pose must be finite, samples in
  // order. False: not believed; what is rendered is as old as before.
  virtual bool update(const ForceSample& sample, const ToolPose& pose, double time_s) noexcept = 0;
  // A newer part of the contact law around the finger; who renders none ignores it.
  virtual void take_law(const NearLaw&) noexcept {}
  // The force at `pose` now; what a harder model puts under a pressed finger is asked of the ledger.
  virtual Rendered render(const ToolPose& pose, double time_s, EnergyLedger&) noexcept = 0;
  // As if everything were paid for.
  Rendered render(const ToolPose& pose, double time_s) noexcept {
    EnergyLedger all({.largest_balance_j = std::numeric_limits<double>::infinity()});
    all.earn(std::numeric_limits<double>::infinity());
    return render(pose, time_s, all);
  }
};

// Finite in every field that a renderer reads.
bool is_finite(const ForceSample&) noexcept;

}  // namespace teletact::client
