// One finger on one scene: picks the window, solves the contact, never throws for what the tissue does.
#pragma once

#include <array>
#include <chrono>
#include <cstdint>
#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "service/contact/contact_laws.h"
#include "service/contact/touch_model.h"
#include "service/scene/scene.h"
#include "service/touch_plane/finger_motion.h"
#include "service/touch_plane/tactile_outbox.h"
#include "service/touch_plane/touch_options.h"

namespace teletact::service {

enum class TouchStatus { kOk, kNotCovered, kDegraded, kFailed, kPreparing };

// What waits below a finger out of contact: a light touch of the same place.
struct ForeseenTouch {
  Vector3 position_m{};
  ContactAnswer contact;
};

struct TouchAnswer {
  TouchStatus status = TouchStatus::kOk;
  ContactAnswer contact;  // zero force unless kOk or kDegraded
  // Used, or asked for where it failed; kAuto without contact, and of a model with a way of its own.
  SolvePath path = SolvePath::kAuto;
  std::uint64_t window_id = 0, model_version = 0;
  std::chrono::steady_clock::time_point taken_in{};  // as the window's
  Region covered;
  std::string warning;
  std::vector<std::string> window_flags;       // names of what makes the window doubtful
  std::optional<FeltDeviation> log_deviation;  // of ln E where it touches (slices.h), where that is known
  std::optional<ForeseenTouch> foreseen;       // only out of contact, where it can be told and trusted
  std::optional<SliceWish> wish;               // here, in contact or above
  bool device_failed = false;                  // why it is kFailed: warning says how
};

// Whether what is being corrected is trusted until it is.
bool trusted_meanwhile(const SolveReport&);

// Not thread-safe: one thread solves.
class TouchSession {
 public:
  // Throws std::invalid_argument (field named) for a fingertip, layer or path that cannot be touched with.
  TouchSession(std::shared_ptr<Scene>, TouchOptions, std::shared_ptr<Device>);
  ~TouchSession();
  TouchSession(const TouchSession&) = delete;
  TouchSession& operator=(const TouchSession&) = delete;

  const Layer& layer() const { return layer_; }
  // What a model may put the force off by, over it: as asked for, or as usual.
  double tolerance() const { return options_.tolerance.value_or(Tolerance{}).relative; }
  const std::shared_ptr<Scene>& scene() const { return scene_; }

  // The device from now on: another one once the former has failed.
  void use(const std::shared_ptr<Device>&);
  // Throws std::invalid_argument for a pose that is not finite. Everything else is an answer: NOT_COVERED
  // (beside the tissue or deeper than it, too), FAILED and PREPARING with zero force, DEGRADED with a
  // warning.
  // Where a newer model of the window may not be entered yet, or is not ready for this finger, the one before
  // answers.
  using MayEnter = std::function<bool(const WindowModel&)>;
  TouchAnswer solve(
      const Vector3& position_m, const MayEnter& = [](const WindowModel&) { return true; });
  // Has the tactile image of this answer to a touch begun, where it says anything of the contact and the next
  // is due.
  void show(TactileOutbox&, std::uint64_t sequence, const Vector3& position_m, const TouchAnswer&) const;
  // Has it found how the layer gives way under this answer's finger, where the answer says anything of the
  // contact, and the job is due; `tell` is told, on another thread perhaps. Out of contact it is told
  // `at_rest` at once. Throws nothing.
  using TellSurface = std::function<void(const std::shared_ptr<const ObservedSurface>&)>;
  void deform(PacedJob&, ObservedSurface at_rest, const Vector3& position_m, const TouchAnswer&,
              const TellSurface& tell) const;
  // After an answer was handed on: what is likely to be needed for the next, where the finger will be if it
  // moves on as it did between the last two. Nothing is owed: what fails is said by the answer that needs it.
  // Throws DeviceError, though, where the device failed.
  void look_ahead();
  // Of one of the scene's windows, for this finger: what is known of it, near x first; null where nothing is.
  std::shared_ptr<const ContactLaw> law_of(const WindowModel&, const Vector3& near_m) const;

 private:
  std::string outside(const Vector3& position_m) const;
  // Whether what the answer says of its contact may be shown without a word.
  bool shows(const TouchAnswer&) const;
  bool enter(const std::shared_ptr<const WindowModel>&, const SceneSnapshot&, const TouchPose&,
             const MayEnter&);
  bool arrived(const TouchPose&);
  void leave_window();
  bool presses_on(const TouchPose&) const;
  bool is_followed(const TouchPose&) const;
  ContactAnswer answered(const TouchPose&);
  void touch_into(TouchAnswer&, const TouchPose&);
  void judge(TouchAnswer&, const SceneSnapshot&, const TouchPose&) const;
  std::string doubt(const ContactAnswer&, const SceneSnapshot&, const TouchPose&) const;
  double measured_share(const StitchedMap&, double x_m) const;
  std::optional<ForeseenTouch> foresee(const SceneSnapshot&, const TouchPose&);
  const std::shared_ptr<Scene> scene_;
  const TouchOptions options_;
  const Layer layer_;
  TouchWay way_;
  std::shared_ptr<const WindowModel> window_;  // that answers: the one under the finger, or that before it
  std::shared_ptr<TouchedLayer> touched_;      // layer_ of window_'s model; there whenever window_ is
  std::shared_ptr<const SceneSnapshot> seen_;  // the newest that has window_
  struct Arriving {
    std::shared_ptr<const WindowModel> window;
    std::shared_ptr<TouchedLayer> layer;
    TouchedLayer::Clock::time_point since;  // of the first that was ready
  };
  std::optional<Arriving> arriving_;      // the newer model that is not entered yet
  std::optional<TouchPose> at_, before_;  // the poses that were touched last
  std::optional<TouchPose> trusted_;      // the last that touched_ answered well
  TouchedLayer::Clock::time_point at_time_, trusted_time_;
  FingerMotion motion_;
};

}  // namespace teletact::service
