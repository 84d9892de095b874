// The surface of solid tissue as one finger touches it: by shares of the force where they are good enough for
// it there, else by the nodes (T9.5).
#pragma once

#include <array>
#include <atomic>
#include <memory>
#include <mutex>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "service/contact/shares_touch.h"
#include "service/contact/solid_layer.h"

namespace teletact::service {

// Why shares answer where nodes were chosen.
inline constexpr const char* kLateReason = "the nodes are not corrected yet, shares answer";
inline constexpr const char* kFailedReason = "the nodes' correction failed, shares answer";
inline constexpr const char* kNoContactReason = "the nodes have no contact";

// A tip that shares do not know, and one whose shares are not learned yet, is answered by the nodes. Where
// these are late, or have no contact (a hard lump at the surface, deep), shares answer if they are off by
// less. Such an answer is of no solution that converged: it says why, and is trusted as far as the nodes' own
// would be.
class PlannedLayer final : public TouchedLayer {
 public:
  // way.path: kAuto, or kShares: they are taken as deep as they know. deviation: as usual_tolerance().
  PlannedLayer(std::shared_ptr<SolidLayer>, const TouchWay&, double deviation);
  SolvePath path() const override { return nodes_->path(); }
  bool prepare(const Fingertip&, const TouchPose&, double around_m, Clock::time_point until) override;
  bool welcomes(const Fingertip&, const TouchPose&) override;
  ContactAnswer touch(const Fingertip&, const TouchPose&) override;
  std::optional<std::vector<NodalPressure>> layered_pressure(const Fingertip&, const TouchPose&,
                                                             double force_n) const override;
  std::optional<DeformedLayer> deformed(const Fingertip& tip, const TouchPose& pose, double around_m,
                                        std::size_t max_nodes) const override {
    return nodes_->deformed(tip, pose, around_m, max_nodes);
  }
  std::string remark(const Fingertip&, const TouchPose&) const override;
  std::shared_ptr<TouchedLayer> apart() override;
  std::array<double, 2> spacing_m(double x_m) const override { return nodes_->spacing_m(x_m); }

 private:
  using Shares = std::shared_ptr<const SharesTouch>;
  PlannedLayer(const PlannedLayer& same, std::shared_ptr<TouchedLayer> nodes);
  // Those that answer; null: the nodes do.
  Shares choose(const Fingertip&, const TouchPose&);
  // Those that know this touch; null: none. Under the mutex.
  Shares shares(const Fingertip&, const Vector3& at);
  double over(const SharesTouch&, const Vector3& at) const;
  bool shares_will_do(const Fingertip&, const Vector3& at);
  // By shares, where they are off by less than this, until the nodes are corrected. None of a law, and none
  // where a tolerance was asked for, which they miss.
  std::optional<ContactAnswer> meanwhile(const Fingertip&, const TouchPose&, double error);
  // Shares as deep as they know; none beyond. Under the mutex.
  std::optional<ContactAnswer> in_the_nodes_place(const Fingertip&, const Vector3& at, const char* reason);
  const std::shared_ptr<SolidLayer> solid_;
  const std::shared_ptr<TouchedLayer> nodes_;  // the same, or apart from it
  const SolvePath path_;
  const bool pressure_;
  const Tolerance tolerance_;
  const bool asked_for_;  // the tolerance
  std::mutex mutex_;      // of these
  const std::shared_ptr<Planner> planner_;
  std::pair<Fingertip, Shares> shares_;  // of the last tip; null: none
  std::atomic<bool> by_nodes_ = true;    // the last answer
};

}  // namespace teletact::service
