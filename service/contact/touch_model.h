// The seam where models of tissue meet touch: what of a model can be touched, and how it answers. Whoever
// touches knows no more of a model than this.
//
// Coordinates are the scene's, [x, y, z] in metres: x along the surface, y into the tissue, z across. All
// types are three-dimensional; that a plane model gives no force along z is the model's own saying.
#pragma once

#include <array>
#include <chrono>
#include <compare>
#include <cstddef>
#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "service/base/force_budget.h"
#include "service/base/memory.h"
#include "service/base/planner.h"
#include "service/tissue/compliance.h"

namespace teletact::service {

class ContactLaws;
class Device;
class TissueModel;
struct SolidState;

using Vector3 = std::array<double, 3>;
using Matrix3 = std::array<double, 9>;  // row-major

// How answers are computed, where a model has several ways; kAuto: the model's own choice. kCompliance is of
// planes, kShares of solids (shares_touch.h).
enum class SolvePath { kAuto, kCompliance, kGradients, kShares };

enum class FingertipShape { kNode, kFlatPunch, kRoundedTip, kPad, kSphere };
enum class Friction { kFrictionless, kStuck };

struct Fingertip {
  FingertipShape shape = FingertipShape::kRoundedTip;
  Friction friction = Friction::kFrictionless;
  double radius_m = 0.008;      // rounded tip: radius of curvature; flat punch and pad: radius of its edges
  double half_width_m = 0.004;  // flat punch and pad: half of the flat part
  double footprint_m = 0;       // node only: standard deviation of a Gaussian footprint, 0 = the hat function
  double pad_m_pa = 0;          // pad only: how far it gives way to a pressure, thickness over modulus
  bool operator==(const Fingertip&) const = default;
};
bool round_and_frictionless(const Fingertip&);

struct RangeZ {
  double begin_m = 0, end_m = 0;
  bool holds(double z_m) const { return z_m >= begin_m && z_m < end_m; }
};

// What is covered, [begin, end) both ways.
struct Region {
  double begin_x_m = 0, end_x_m = 0;
  std::optional<RangeZ> z = {};  // none: a plane's, whose tissue is the same at every z
};

// A plane of points in the undeformed tissue that a tip is pressed on: the surface, or one inside.
struct Layer {
  double depth_m = 0;       // of its point below the scene's origin
  Vector3 normal{0, 1, 0};  // unit vector across it, the way a tip is pressed
  auto operator<=>(const Layer&) const = default;
};

// Of a tip's foremost point, measured from the layer's point below the origin: [x, y - depth_m, z].
struct TouchPose {
  Vector3 position_m{};
  // How it moves, where that is known: what is made ready meanwhile is for where it will be. turn: of the
  // velocity, from x towards z.
  Vector3 velocity_m_s{};
  double turn_rad_s = 0;
};
// How deep it is beyond the undeformed layer; negative: not touching.
double indentation_m(const Layer&, const TouchPose&);
// The pose above or below the same point of the layer that is `indentation_m` deep.
TouchPose at_indentation(const Layer&, const TouchPose&, double indentation_m);

struct NodalPressure {
  Vector3 position_m{};             // undeformed, in the scene
  double pressure_pa = 0;           // >= 0 pushes into the tissue
  Vector3 traction_pa{};            // tangential (stuck), on the tissue
  std::array<double, 2> width_m{};  // of its share of the layer, along x and z: what the pressure acts on
};

// How a layer gives way: its nodes in the scene, increasing, and how far each moves along the layer's normal,
// > 0 into the tissue, [z][x].
struct DeformedLayer {
  std::vector<double> x_m, z_m;
  std::vector<float> displacement_m;
};

// Of indices along an axis every second, or third ..., so that there are at most so many: the same ones
// wherever the finger is.
std::vector<std::size_t> every(const std::vector<std::size_t>& indices, std::size_t most);

enum class ContactState { kNoContact, kContact };

// Of a linear model; beyond, it is said.
inline constexpr double kLargestLinearStrain = 0.15;

// What the client gets (T4.5). force_n acts on the finger: F = -dU/dposition, so it points against the
// layer's normal. tangent_n_m = dF/dposition, symmetric.
struct ContactAnswer {
  ContactState state = ContactState::kNoContact;
  Vector3 force_n{};
  Matrix3 tangent_n_m{};
  double energy_j = 0;                  // U(position)
  std::vector<NodalPressure> pressure;  // where it is above zero
  double largest_strain = 0;            // peak principal strain in the tissue, about
  bool strain_beyond_linear = false;    // largest_strain > kLargestLinearStrain
  std::size_t iterations = 0;           // of the contact solve, Newton's
  SolveReport solve;                    // relative_error: what the solver states the force may be off by
  SolvePath path = SolvePath::kAuto;    // by which it was found
  ForceBudget budget;                   // empty: the model does not state all that it may be off by
  // What to know of it, though it is right, such as a mesh too coarse for the tip; empty: nothing.
  std::string remark = {};
};

struct TouchWay {
  SolvePath path = SolvePath::kAuto;
  std::shared_ptr<Device> device = {};      // where the path asks for one
  std::string client = {};                  // in whose turn it is made ready
  bool shares = true;                       // of a tip that has some
  std::optional<Tolerance> tolerance = {};  // none: as usual, or half of what the modulus is known to
  bool pressure = false;                    // answers have to tell pressures
  std::shared_ptr<Planner> planner = {};    // of the finger; none: each touch is planned on its own
  // To sample its law by: one thread touches it in many places, and what it learns is no loss to others.
  bool law = false;
};

// Has jobs done that a touch asks for and must not wait for, some time, on another thread, where clients take
// turns. Empty: nobody does; what is asked for is then made in place.
using TouchWork = std::function<void(const std::string& client, std::function<void()>)>;

// Whether a finger that is put down waits for a job.
enum class JobWait {
  kBeside,   // it is answered meanwhile
  kAwaited,  // it is answered once that is done, or the time is up
  kFirst     // the same, and has no answer before that is done
};

// What would make the answers at a pose better, for whoever schedules it.
struct TouchJob {
  // Of the force, relative, as it is known without it; infinite: nothing is known; 0: it is for where the
  // finger will be.
  double error = 0;
  JobWait wait = JobWait::kBeside;
  // Works in small steps, none of which is begun after `until`, or has it done beside, at once, and waits
  // for that until then. True when it is done. Throws what makes an answer impossible. Not beyond the layer.
  std::function<bool(std::chrono::steady_clock::time_point until)> work = {};
};

// A layer of a model that is ready to be touched, for as long as somebody holds it. Thread-safe; one that
// samples a law is touched by one thread at a time.
class TouchedLayer {
 public:
  using Clock = std::chrono::steady_clock;
  explicit TouchedLayer(std::shared_ptr<Device> device = {}) : device_(std::move(device)) {}
  virtual ~TouchedLayer() = default;
  // On which it is solved; null: on none.
  const std::shared_ptr<Device>& device() const { return device_; }
  // By what is known now, waiting for nothing: with an infinite relative_error where that is nothing yet.
  // Throws std::out_of_range where the model cannot be touched, std::invalid_argument (field named) for an
  // unusable fingertip or pose, std::domain_error when no finite answer exists.
  virtual ContactAnswer answer(const Fingertip&, const TouchPose&) = 0;
  // What would make that better and, where around_m is above 0, the answers within it of the pose; none:
  // nothing would. Throws as answer(), and MemoryRefused where there is no room.
  virtual std::optional<TouchJob> wanted(const Fingertip&, const TouchPose&, double /*around_m*/) {
    return std::nullopt;
  }
  // What would press `force_n` in all under the same tip, at the same place, if the tissue's stiffness
  // changed with depth alone; none where the model cannot tell. By any thread, beside the others. Throws as
  // answer().
  virtual std::optional<std::vector<NodalPressure>> layered_pressure(const Fingertip&, const TouchPose&,
                                                                     double /*force_n*/) const {
    return std::nullopt;
  }
  // How it gives way under the tip at this pose, by the nodal forces of its contact: its nodes up to
  // `around_m` of the tip along x and z, every second or third where more than `max_nodes` would be told;
  // none where it cannot tell. By any thread, beside the others. Throws as answer().
  virtual std::optional<DeformedLayer> deformed(const Fingertip&, const TouchPose&, double /*around_m*/,
                                                std::size_t /*max_nodes*/) const {
    return std::nullopt;
  }
  // From one node to the next around here, along x and z: forces ripple with it. 0: they do not.
  virtual std::array<double, 2> spacing_m(double /*x_m*/) const { return {}; }

 private:
  const std::shared_ptr<Device> device_;
};

// The tissue that a model is of, and what the model that takes its place may use again: a plane's, a solid's,
// or none.
struct MadeOf {
  std::shared_ptr<const TissueModel> plane = {};
  std::shared_ptr<SolidState> solid = {};
};

// The model that is touched: immutable once made, shared by any number of touch streams. Thread-safe.
class TouchModel {
 public:
  // `account`: in whose name its contact laws are held.
  explicit TouchModel(MemoryAccount account = {}, MadeOf made_of = {});
  virtual ~TouchModel() = default;
  virtual Region region() const = 0;              // where it can be touched
  virtual std::vector<Layer> layers() const = 0;  // by depth
  // Which of its ways a usual touch is answered by, and why, in a sentence; empty: it has no choice.
  virtual std::string plan() const { return ""; }
  // One of its layers, to be touched this way; null while it is being made ready, which this asks `work` for.
  // Throws std::out_of_range for a layer that it has not, and what making it ready throws, here or
  // elsewhere.
  virtual std::shared_ptr<TouchedLayer> layer(const Layer&, const TouchWay&, const TouchWork& work) const = 0;
  // What is to take its place once slices have worn it: ready, where it was; null while it serves.
  virtual std::shared_ptr<const TouchModel> renewed(const MemoryAccount&) const { return nullptr; }
  const MadeOf& made_of() const { return made_of_; }
  // What the forces of its layers are interpolated from, so that they can be felt far away.
  ContactLaws& laws() const { return *laws_; }

 private:
  const MadeOf made_of_;
  const std::shared_ptr<ContactLaws> laws_;
};

// What the force of any of these may lack under a round tip, over it, where tissue stiffens with strain
// (T9.4).
double stiffening(const Fingertip&, double indentation_m);
// The share of it that is lost where tissue slides on its support: of nu 0.49 and more, less of other tissue,
// where sqrt(R d) is at most 0.4 of the depth (T9.6).
double lost_by_sliding(const Fingertip&, double indentation_m, double depth_m);

}  // namespace teletact::service
