// A plane of nodes of a block of solid tissue as one finger touches it: by shares of the force where they are
// good enough for it there (T9.5), else by the nodes, which are corrected beside.
#pragma once

#include <array>
#include <memory>
#include <mutex>
#include <optional>
#include <utility>
#include <vector>

#include "service/contact/shares_touch.h"
#include "service/contact/solid_nodes.h"
#include "service/contact/touch_model.h"

namespace teletact::service {

// Why shares answer where nodes were chosen.
inline constexpr const char* kLateReason = "the nodes are not corrected yet, shares answer";
inline constexpr const char* kFailedReason = "the nodes' correction failed, shares answer";
inline constexpr const char* kNoContactReason = "the nodes have no contact";

// A tip that shares do not know, and one whose shares are not learned yet, is answered by the nodes. Where
// these are late, or have no contact (a hard lump at the surface, deep), shares answer if they are off by
// less. Such an answer is of no solution that converged: it says why, and is trusted as far as the nodes' own
// would be.
class SolidLayer final : public TouchedLayer {
 public:
  // way.path: kAuto, kShares: they are taken as deep as they know, or kGradients: the nodes alone. way.law:
  // it has nodes of its own, made when they are asked for, and all that it wants is corrected where it is
  // wanted. deviation: as usual_tolerance().
  SolidLayer(std::shared_ptr<SolidNodes>, const TouchWay&, double deviation);
  ContactAnswer answer(const Fingertip&, const TouchPose&) override;
  std::optional<TouchJob> wanted(const Fingertip&, const TouchPose&, double around_m) override;
  std::optional<std::vector<NodalPressure>> layered_pressure(const Fingertip&, const TouchPose&,
                                                             double force_n) const override;
  std::optional<DeformedLayer> deformed(const Fingertip&, const TouchPose&, double around_m,
                                        std::size_t max_nodes) const override;
  std::array<double, 2> spacing_m(double) const override { return nodes_->spacing_m; }

 private:
  using Shares = std::shared_ptr<const SharesTouch>;
  struct Chosen {
    Fingertip tip;
    Vector3 at{};
    bool shares = false;
  };
  struct Last {
    Fingertip tip;
    Vector3 position_m;
    std::uint64_t done;  // corrections by then
    ContactAnswer answer;
  };
  // Those that answer; null: the nodes do.
  Shares choose(const Fingertip&, const Vector3& at);
  // Those that know this touch; null: none. Under the mutex.
  Shares shares(const Fingertip&, const Vector3& at);
  double over(const SharesTouch&, const Vector3& at) const;
  // Whether they answered there last, or would.
  bool shares_will_do(const Fingertip&, const Vector3& at);
  // By shares, where they are off by less than this, until the nodes are corrected. None of a law, and none
  // where a tolerance was asked for, which they miss.
  std::optional<ContactAnswer> meanwhile(const Fingertip&, const Vector3& at, double error);
  // Shares as deep as they know; none beyond.
  std::optional<ContactAnswer> in_the_nodes_place(const Fingertip&, const Vector3& at, const char* reason);
  ContactAnswer by_nodes(const Fingertip&, const TouchPose&);
  ContactAnswer answered(const Fingertip&, const TouchPose&);  // by what was learned up to now
  bool correct(const Fingertip&, const TouchPose&, Clock::time_point until);
  std::optional<TouchJob> wanted_of_law(const Fingertip&, const Vector3& at);
  void make_own();
  const std::shared_ptr<SolidNodes> nodes_;
  const bool law_, planned_, by_name_, pressure_;
  const bool asked_for_;  // the tolerance
  const Tolerance tolerance_;
  std::mutex mutex_;  // of these
  const std::shared_ptr<Planner> planner_;
  std::optional<std::pair<Fingertip, Shares>> shares_;  // of the last tip; null: none
  std::optional<Chosen> chosen_;
  std::optional<Last> last_;
  std::shared_ptr<SolidNodes> of_law_;  // of one thread
  bool felt_ = false;                   // what they are corrected from
};

}  // namespace teletact::service
