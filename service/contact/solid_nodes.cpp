#include "service/contact/solid_nodes.h"

#include <fmt/format.h>
#include <spdlog/spdlog.h>

#include <algorithm>
#include <cmath>
#include <stdexcept>
#include <utility>

#include "service/base/choices.h"
#include "service/contact/fingertip.h"
#include "service/device/device.h"

namespace teletact::service {
namespace {

constexpr std::chrono::seconds kLearnAgain{1};
// A correction is as good as this share of what is stated where it is made: at most so coarse, a fast finger
// is soon elsewhere.
constexpr double kCorrected = 0.2, kMaxCorrected = 0.01;

double around(double period_m, double begin_m, double end_m) {
  return (period_m - (end_m - begin_m)) / 2;
}

}  // namespace

bool settled(const SolveReport& solve) {
  return solve.converged || solve.reason == kRoundingReason;
}

SolidNodes::SolidNodes(const SolidBlock& block, const std::shared_ptr<Device>& on, const MemoryAccount& of)
    : region(block.region),
      origin_x_m(block.origin_x_m),
      origin_z_m(block.origin_z_m),
      spacing_m{block.tissue.grid.spacing_x_m, block.tissue.grid.spacing_z_m},
      account(of),
      device(on),
      mutex(std::make_shared<std::mutex>()),
      contact(on->queue(of), block.tissue),
      around_x_m_(around(static_cast<double>(block.tissue.grid.nx) * block.tissue.grid.spacing_x_m,
                         region.begin_x_m, region.end_x_m)),
      around_z_m_(around(static_cast<double>(block.tissue.grid.nz) * block.tissue.grid.spacing_z_m,
                         region.z->begin_m, region.z->end_m)) {}

// At the same place.
template <class Make>
SolidNodes::SolidNodes(const SolidNodes& other, const MemoryAccount& of, Charge charged, const Make& make)
    : region(other.region),
      origin_x_m(other.origin_x_m),
      origin_z_m(other.origin_z_m),
      spacing_m(other.spacing_m),
      account(of),
      device(other.device),
      mutex(other.mutex),
      charge(std::move(charged)),
      contact(make()),
      around_x_m_(other.around_x_m_),
      around_z_m_(other.around_z_m_) {}

SolidNodes::SolidNodes(const SolidBlock& block, const SolidNodes& before, const MemoryAccount& of)
    : SolidNodes(before, of, {}, [&] {
        return SolidContact<float>(before.device->queue(of), before.contact, block.tissue);
      }) {
  follows_learned_ = before.contact.has_learned();
}

// Its copy of the moduli, what its touches leave and the shares of energy.
SolidNodes::SolidNodes(const SolidNodes& same, std::size_t row, const MemoryAccount& of)
    : SolidNodes(
          same, of,
          of.charge(Place::kHost, "solids",
                    16 * same.contact.tissue().grid.elements() + 1600 * same.contact.tissue().grid.columns()),
          [&] { return SolidContact<float>(same.contact, row); }) {}

void SolidNodes::learn_shares() {
  contact.learn_shares(device->queue(account), *mutex);
}

bool SolidNodes::learned(const std::shared_ptr<SolidNodes>& nodes, const TouchWork& work,
                         const std::string& client) {
  using Clock = TouchedLayer::Clock;
  if (nodes->contact.has_learned()) return true;
  {
    const std::lock_guard lock(nodes->learned_mutex_);
    if (nodes->asked_to_learn_ || Clock::now() < nodes->learns_again_) return false;
    nodes->asked_to_learn_ = true;
  }
  const auto learn = [weak = std::weak_ptr(nodes)] {
    const auto nodes = weak.lock();
    if (!nodes) return;
    std::exception_ptr failure;
    try {
      nodes->learn_shares();
    } catch (const std::exception& error) {
      spdlog::warn("event=shares_not_learned error=\"{}\"", error.what());
      failure = std::current_exception();
    }
    const std::lock_guard lock(nodes->learned_mutex_);
    nodes->asked_to_learn_ = false;
    nodes->not_learned_ = failure;
    nodes->learns_again_ = Clock::now() + kLearnAgain;
  };
  if (work)
    work(client, learn);
  else
    learn();
  return nodes->contact.has_learned();
}

std::exception_ptr SolidNodes::not_learned() {
  const std::lock_guard lock(learned_mutex_);
  return not_learned_;
}

Vector3 SolidNodes::in_block(const TouchPose& pose) const {
  const auto [x, y, z] = pose.position_m;
  return {x - origin_x_m, y, z - origin_z_m};
}

void SolidNodes::move_to_scene(std::vector<NodalPressure>& pressure) const {
  for (NodalPressure& p : pressure) {
    p.position_m[0] += origin_x_m;
    p.position_m[2] += origin_z_m;
  }
}

bool SolidNodes::covers(const Fingertip& tip, const Vector3& position_m) const {
  const auto [x, y, z] = position_m;
  const double reach = tip.shape == FingertipShape::kNode ? 3 * tip.footprint_m : reach_m(tip, y, 0);
  const auto inside = [reach](double at, double begin, double end, double around) {
    return at >= begin && at < end && at - reach > begin - around && at + reach < end + around;
  };
  return inside(x, region.begin_x_m, region.end_x_m, around_x_m_) &&
         inside(z, region.z->begin_m, region.z->end_m, around_z_m_);
}

void SolidNodes::require_covered(const Fingertip& tip, const TouchPose& pose) const {
  const auto [x, y, z] = pose.position_m;
  if (!covers(tip, pose.position_m))
    throw std::out_of_range(
        fmt::format("pose: at x {:.4g} m, z {:.4g} m the tip is beside the solid, which reaches from "
                    "{:.4g} to {:.4g} m along x "
                    "and from {:.4g} to {:.4g} m along z",
                    x, z, region.begin_x_m, region.end_x_m, region.z->begin_m, region.z->end_m));
}

void SolidNodes::correct(const Fingertip& tip, const TouchPose& pose) {
  if (!covers(tip, pose.position_m)) return;  // it leaves
  try {
    const SolveReport known = contact.answer(tip, in_block(pose)).solve;
    if (settled(known)) return;
    // A finger that moves on waits for the slice ahead of it, not for what it does not feel.
    const auto [vx, vy, vz] = pose.velocity_m_s;
    if (device->is_imaging() && std::hypot(vx, vy, vz) > 0 &&
        known.relative_error - known.of_model <= choices::kTrustedMeanwhile)
      return;
    const std::lock_guard lock(*mutex);
    const double asked =
        std::clamp(kCorrected * known.relative_error, choices::kSolidForceError, kMaxCorrected);
    iterations += contact.correct(tip, in_block(pose), asked).iterations;
  } catch (const std::out_of_range&) {  // said by the answer when the finger is there
  } catch (const std::invalid_argument&) {
  }
}

}  // namespace teletact::service
