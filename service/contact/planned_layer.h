// The surface of solid tissue as one finger touches it: by the cheapest model that is good enough for it
// there (T9.5). Closed forms where they do, else the nodes.
#pragma once

#include <array>
#include <atomic>
#include <memory>
#include <mutex>
#include <optional>
#include <stdexcept>
#include <string>
#include <utility>
#include <vector>

#include "service/contact/closed_touch.h"
#include "service/contact/solid_layer.h"

namespace teletact::service {

// What closed forms may be off by over what is allowed, the cheapest first: layers at their worst place,
// shares there. Pose: as ClosedTouch has it.
inline constexpr std::array kClosedForms{SolvePath::kLayer, SolvePath::kLayers, SolvePath::kShares};
std::array<double, kClosedForms.size()> over_allowed(const ClosedTouch&, const Vector3& pose,
                                                     const Tolerance&, FiniteStrain);
// Why shares answer where nodes were chosen.
inline constexpr const char* kLateReason = "the nodes are not corrected yet, shares answer";
inline constexpr const char* kFailedReason = "the nodes' correction failed, shares answer";
inline constexpr const char* kNoContactReason = "the nodes have no contact";
// What answers a touch by that tip, and why, in a sentence.
std::string plan_of(const Fingertip&, const ClosedTouch&, const Tolerance&);

// A tip without closed form, and one whose shares are not learned yet, is answered by the nodes. Where these
// are late, or have no contact (a hard lump at the surface, deep), shares answer if they are off by less.
// Such an answer is of no solution that converged: it says why, and is trusted as far as the nodes' own would
// be.
class PlannedLayer final : public TouchedLayer {
 public:
  // way.path: kAuto, or the closed form that is taken as deep as it knows. deviation: as usual_tolerance().
  PlannedLayer(std::shared_ptr<SolidLayer>, const TouchWay&, double deviation);
  SolvePath path() const override { return nodes_->path(); }
  bool prepare(const Fingertip&, const TouchPose&, double around_m, Clock::time_point until) override;
  bool welcomes(const Fingertip&, const TouchPose&) override;
  ContactAnswer touch(const Fingertip&, const TouchPose&) override;
  std::optional<std::vector<NodalPressure>> layered_pressure(const Fingertip&, const TouchPose&,
                                                             double force_n) const override;
  std::optional<DeformedLayer> deformed(const Fingertip& tip, const TouchPose& pose, double around_m,
                                        std::size_t most_nodes) const override {
    return nodes_->deformed(tip, pose, around_m, most_nodes);
  }
  std::string remark(const Fingertip&, const TouchPose&) const override;
  std::shared_ptr<TouchedLayer> apart() override;
  std::array<double, 2> spacing_m(double x_m) const override { return nodes_->spacing_m(x_m); }

 private:
  struct Choice {  // null: the nodes
    std::shared_ptr<const ClosedTouch> closed;
    SolvePath path = SolvePath::kPcg;
  };
  PlannedLayer(const PlannedLayer& same, std::shared_ptr<TouchedLayer> nodes);
  Choice choose(const Fingertip&, const TouchPose&);
  std::array<double, kClosedForms.size()> over(const ClosedTouch&, const Vector3& at) const;
  // Whether one of them answers well enough.
  bool closed_will_do(const Fingertip&, const Vector3& at);
  std::shared_ptr<const ClosedTouch> closed(const Fingertip&);  // under the mutex
  // By shares, where they are off by less than this, until the nodes are corrected. None of a law, and none
  // where a tolerance was asked for, which they miss.
  std::optional<ContactAnswer> meanwhile(const Fingertip&, const TouchPose&, double error);
  // Shares as deep as they know; null beyond.
  std::optional<ContactAnswer> in_the_nodes_place(const Fingertip&, const Vector3& at, const char* reason);
  const std::shared_ptr<SolidLayer> solid_;
  const std::shared_ptr<TouchedLayer> nodes_;  // the same, or apart from it
  const SolvePath path_;
  const bool pressure_;
  const Tolerance tolerance_;
  const bool asked_for_;  // the tolerance
  std::mutex mutex_;      // of these
  const std::shared_ptr<Planner> planner_;
  std::pair<Fingertip, std::shared_ptr<const ClosedTouch>> closed_;  // of the last tip; null: none
  std::atomic<bool> by_nodes_ = true;                                // the last answer
};

}  // namespace teletact::service
