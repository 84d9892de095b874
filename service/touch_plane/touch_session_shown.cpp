// What is shown of a touch beside its answer: tactile images, how the layer gives way.
#include <exception>
#include <utility>

#include "service/base/choices.h"
#include "service/touch_plane/touch_session.h"

namespace teletact::service {

bool TouchSession::shows(const TouchAnswer& answer) const {
  if (answer.status != TouchStatus::kOk && answer.status != TouchStatus::kDegraded) return false;
  const SolveReport& solve = answer.contact.solve;
  return touched_ && (solve.converged || trusted_meanwhile(solve));  // an image cannot say so
}

void TouchSession::show(TactileOutbox& outbox, std::uint64_t sequence, const Vector3& position_m,
                        const TouchAnswer& answer) const {
  const auto now = TactileOutbox::Clock::now();
  if (!shows(answer) || !outbox.due(now)) return;
  const auto [x_m, y_m, z_m] = position_m;
  // A plane's contact lies about z = 0, wherever the finger is.
  const bool plane = !window_->region.z;
  const auto make = [touched = touched_, tip = options_.fingertip, grid = outbox.grid(),
                     nodes = answer.contact.pressure, pose = TouchPose{{x_m, y_m - layer_.depth_m, z_m}},
                     centre = Vector3{x_m, layer_.depth_m, plane ? 0 : z_m}] {
    return tactile_image(*touched, tip, pose, nodes, grid, centre);
  };
  outbox.begin(now, sequence, make, scene_->touch_work(), options_.client);
}

void TouchSession::deform(PacedJob& job, ObservedSurface at_rest, const Vector3& position_m,
                          const TouchAnswer& answer, const TellSurface& tell) const try {
  using Clock = PacedJob::Clock;
  const bool solved = answer.status == TouchStatus::kOk || answer.status == TouchStatus::kDegraded;
  if (solved && answer.contact.state == ContactState::kNoContact)
    return tell(std::make_shared<const ObservedSurface>(std::move(at_rest)));
  if (!shows(answer) || !job.due(Clock::now())) return;
  const auto [x_m, y_m, z_m] = position_m;
  const auto find = [touched = touched_, tip = options_.fingertip, surface = std::move(at_rest), tell,
                     pose = TouchPose{{x_m, y_m - layer_.depth_m, z_m}}]() mutable {
    const auto begun = Clock::now();
    try {
      auto layer = touched->deformed(tip, pose, choices::kSurfaceAround, choices::kMaxSurfaceNodes);
      if (!layer) return;
      surface.layer = *std::move(layer);
    } catch (const std::exception&) {  // the model's limits: the answer stands
      return;
    }
    surface.took = Clock::now() - begun;
    tell(std::make_shared<const ObservedSurface>(std::move(surface)));
  };
  job.begin(Clock::now(), choices::kSurfacePeriod, find, scene_->touch_work(), options_.client);
} catch (const std::exception&) {  // there is no room for the work: nobody is owed it
}

}  // namespace teletact::service
