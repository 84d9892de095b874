#include "service/contact/solid_layer.h"

#include <fmt/format.h>
#include <spdlog/spdlog.h>

#include <algorithm>
#include <cmath>
#include <stdexcept>
#include <utility>

#include "service/contact/fingertip.h"
#include "service/device/device.h"

namespace teletact::service {
namespace {

double around(double period_m, double begin_m, double end_m) {
  return (period_m - (end_m - begin_m)) / 2;
}

// A finger slower than this rests; one that would be faster, or is farther from where it was known, was put
// down elsewhere. A correction is as good as this share of what is stated where it is made: at most so
// coarse, a fast finger is soon elsewhere.
constexpr std::chrono::seconds kLearnAgain{1};
constexpr double kStillMS = 0.001, kFastestMS = 0.5, kFarthestM = 0.008, kCorrected = 0.2,
                 kMaxCorrected = 0.01;

// What no correction makes better is settled too: the answer says what it is off by.
bool settled(const SolveReport& solve) {
  return solve.converged || solve.reason == kRoundingReason;
}

bool good(const SolveReport& solve) {
  return settled(solve) || solve.relative_error - solve.of_model <= choices::kTrustedMeanwhile;
}

}  // namespace

SolidLayer::SolidLayer(const SolidBlock& block, const std::shared_ptr<Device>& device,
                       const MemoryAccount& account)
    : region_(block.region),
      origin_x_m_(block.origin_x_m),
      origin_z_m_(block.origin_z_m),
      around_x_m_(around(static_cast<double>(block.tissue.grid.nx) * block.tissue.grid.spacing_x_m,
                         region_.begin_x_m, region_.end_x_m)),
      around_z_m_(around(static_cast<double>(block.tissue.grid.nz) * block.tissue.grid.spacing_z_m,
                         region_.z->begin_m, region_.z->end_m)),
      spacing_m_{block.tissue.grid.spacing_x_m, block.tissue.grid.spacing_z_m},
      account_(account),
      device_(device),
      mutex_(std::make_shared<std::mutex>()),
      contact_(device->queue(account), block.tissue) {}

// At the same place.
template <class Make>
SolidLayer::SolidLayer(const SolidLayer& other, const MemoryAccount& account, Charge charge,
                       const Make& contact)
    : region_(other.region_),
      origin_x_m_(other.origin_x_m_),
      origin_z_m_(other.origin_z_m_),
      around_x_m_(other.around_x_m_),
      around_z_m_(other.around_z_m_),
      spacing_m_(other.spacing_m_),
      account_(account),
      device_(other.device_),
      mutex_(other.mutex_),
      charge_(std::move(charge)),
      contact_(contact()) {}

SolidLayer::SolidLayer(const SolidBlock& block, const SolidLayer& before, const MemoryAccount& account)
    : SolidLayer(before, account, {}, [&] {
        return SolidContact<float>(before.device_->queue(account), before.contact_, block.tissue);
      }) {
  follows_learned_ = before.contact_.has_learned();
}

// Its copy of the moduli, what its touches leave and the shares of energy.
SolidLayer::SolidLayer(const SolidLayer& same, std::size_t row, const MemoryAccount& account)
    : SolidLayer(same, account,
                 account.charge(Place::kHost, "solids",
                                16 * same.contact_.tissue().grid.elements() +
                                    1600 * same.contact_.tissue().grid.columns()),
                 [&] { return SolidContact<float>(same.contact_, row); }) {}

// Touched in many places by one thread, which waits for the corrections that it asks for.
class LayerApart final : public TouchedLayer {
 public:
  explicit LayerApart(const SolidLayer& same) : layer_(same, same.contact_.row(), same.account_) {}
  SolvePath path() const override { return layer_.path(); }
  std::array<double, 2> spacing_m(double x_m) const override { return layer_.spacing_m(x_m); }

  bool prepare(const Fingertip& tip, const TouchPose& pose, double, Clock::time_point) override {
    layer_.require_covered(tip, pose);
    for (std::size_t corrections = 0; corrections < choices::kMaxCorrections; ++corrections) {
      const SolveReport known = layer_.contact_.answer(tip, layer_.in_block(pose), choices::kLawShare).solve;
      if (settled(known)) break;
      const std::lock_guard lock(*layer_.mutex_);  // for one: others wait with a finger
      layer_.contact_.correct(tip, layer_.in_block(pose), choices::kLawShare);
    }
    return true;
  }

  ContactAnswer touch(const Fingertip& tip, const TouchPose& pose) override {
    layer_.require_covered(tip, pose);
    if (!felt_) {
      const std::lock_guard lock(*layer_.mutex_);
      layer_.contact_.feel();
      felt_ = true;
    }
    ContactAnswer answer = layer_.contact_.felt_answer(tip, layer_.in_block(pose));
    layer_.move_to_scene(answer.pressure);
    return answer;
  }

 private:
  SolidLayer layer_;
  bool felt_ = false;
};

std::shared_ptr<TouchedLayer> SolidLayer::apart() {
  return std::make_shared<LayerApart>(*this);
}

void SolidLayer::learn_shares() {
  contact_.learn_shares(device_->queue(account_), *mutex_);
}

bool SolidLayer::learned(const std::shared_ptr<SolidLayer>& layer, const TouchWork& work,
                         const std::string& client) {
  if (layer->contact_.has_learned()) return true;
  {
    const std::lock_guard lock(layer->learned_mutex_);
    if (layer->asked_to_learn_ || Clock::now() < layer->learns_again_) return false;
    layer->asked_to_learn_ = true;
  }
  const auto learn = [weak = std::weak_ptr(layer)] {
    const auto layer = weak.lock();
    if (!layer) return;
    std::exception_ptr failure;
    try {
      layer->learn_shares();
    } catch (const std::exception& error) {
      spdlog::warn("event=shares_not_learned error=\"{}\"", error.what());
      failure = std::current_exception();
    }
    const std::lock_guard lock(layer->learned_mutex_);
    layer->asked_to_learn_ = false;
    layer->not_learned_ = failure;
    layer->learns_again_ = Clock::now() + kLearnAgain;
  };
  if (work)
    work(client, learn);
  else
    learn();
  return layer->contact_.has_learned();
}

std::exception_ptr SolidLayer::not_learned() {
  const std::lock_guard lock(learned_mutex_);
  return not_learned_;
}

bool SolidLayer::prepare(const Fingertip& tip, const TouchPose& pose, double around_m,
                         Clock::time_point until) {
  if (pose.position_m[1] <= 0 || around_m > 0) return true;
  for (std::size_t corrections = 0;; ++corrections) {
    const std::uint64_t done = corrector_.done();
    if (settled(answered(tip, pose).solve) || follows(pose) || corrections == choices::kMaxCorrections)
      return true;
    const std::exception_ptr failure = corrector_.failure();
    if (failure && corrections > 0) std::rethrow_exception(failure);  // it was waited for
    // The time is up: what is known so well is told, as to a finger that is followed.
    if (Clock::now() >= until) return corrections > 0 && good(answered(tip, pose).solve);
    corrector_.ask(tip, {pose.position_m});
    corrector_.wait_for_more_than(done, until + choices::kLongestSolve);  // one that is begun ends
  }
}

bool SolidLayer::welcomes(const Fingertip& tip, const TouchPose& pose) {
  if (pose.position_m[1] <= 0 || corrector_.failure()) return true;  // which touch() says
  const SolveReport known = answered(tip, pose).solve;
  if (!good(known)) {
    corrector_.ask(tip, pose);
    return false;
  }
  if (!settled(known)) follow(pose);
  return true;
}

std::string SolidLayer::remark(const Fingertip& tip, const TouchPose& pose) const {
  return coarse_mesh(tip, pose.position_m[1], std::max(spacing_m_[0], spacing_m_[1]));
}

ContactAnswer SolidLayer::touch(const Fingertip& tip, const TouchPose& pose) {
  const std::exception_ptr failure = corrector_.failure();
  if (failure) rethrow_of_device(failure);
  ContactAnswer answer = answered(tip, pose);
  const auto [vx, vy, vz] = pose.velocity_m_s;
  if (pose.position_m[1] > 0 && (!settled(answer.solve) || std::hypot(vx, vy, vz) > kStillMS))
    corrector_.ask(tip, pose);
  answer.solve.iterations = iterations_.exchange(0);
  if (!settled(answer.solve)) {
    answer.solve.improving = !failure;
    answer.solve.reason = failure ? "its correction failed" : "not corrected yet";
  }
  if (good(answer.solve)) follow(pose);
  move_to_scene(answer.pressure);
  return answer;
}

std::optional<std::vector<NodalPressure>> SolidLayer::layered_pressure(const Fingertip& tip,
                                                                       const TouchPose& pose,
                                                                       double force_n) const {
  if (force_n <= 0) return std::vector<NodalPressure>{};
  auto pressure = contact_.layered_pressure(tip, in_block(pose), force_n);
  move_to_scene(pressure);
  return pressure;
}

std::optional<DeformedLayer> SolidLayer::deformed(const Fingertip& tip, const TouchPose& pose,
                                                  double around_m, std::size_t max_nodes) const {
  require_covered(tip, pose);
  const SolidGrid& grid = contact_.tissue().grid;
  const auto most = static_cast<std::size_t>(std::sqrt(static_cast<double>(max_nodes)));
  const auto shown = [&](std::size_t count, double origin_m, double spacing_m, double at_m, double begin_m,
                         double end_m, std::vector<double>& places_m) {
    std::vector<std::size_t> indices;
    for (std::size_t i = 0; i < count; ++i) {
      const double place_m = origin_m + spacing_m * static_cast<double>(i);
      if (place_m >= begin_m && place_m <= end_m && std::abs(place_m - at_m) <= around_m)
        indices.push_back(i);
    }
    indices = every(indices, most);
    for (const std::size_t i : indices) places_m.push_back(origin_m + spacing_m * static_cast<double>(i));
    return indices;
  };
  DeformedLayer out;
  const auto along_x = shown(grid.nx, origin_x_m_, grid.spacing_x_m, pose.position_m[0], region_.begin_x_m,
                             region_.end_x_m, out.x_m);
  const auto along_z = shown(grid.nz, origin_z_m_, grid.spacing_z_m, pose.position_m[2], region_.z->begin_m,
                             region_.z->end_m, out.z_m);
  std::vector<std::size_t> nodes;
  for (const std::size_t k : along_z)
    for (const std::size_t i : along_x) nodes.push_back(i + grid.nx * k);
  const Eigen::VectorXd moved = contact_.moved_m(tip, in_block(pose), nodes);
  out.displacement_m.assign(moved.begin(), moved.end());
  return out;
}

Vector3 SolidLayer::in_block(const TouchPose& pose) const {
  const auto [x, y, z] = pose.position_m;
  return {x - origin_x_m_, y, z - origin_z_m_};
}

void SolidLayer::move_to_scene(std::vector<NodalPressure>& nodes) const {
  for (NodalPressure& p : nodes) {
    p.position_m[0] += origin_x_m_;
    p.position_m[2] += origin_z_m_;
  }
}

bool SolidLayer::follows(const TouchPose& pose) {
  const std::lock_guard lock(last_mutex_);
  return own_track(pose) != tracks_.end();
}

void SolidLayer::follow(const TouchPose& pose) {
  const std::lock_guard lock(last_mutex_);
  if (const auto own = own_track(pose); own != tracks_.end()) tracks_.erase(own);
  tracks_.push_back({pose.position_m, Clock::now()});
  if (tracks_.size() > Corrector::kMaxFingers) tracks_.pop_front();
}

auto SolidLayer::own_track(const TouchPose& pose) -> std::deque<Track>::iterator {
  return std::ranges::find_if(tracks_, [&, now = Clock::now()](const Track& track) {
    const auto& [x, y, z] = track.position_m;
    const auto& [px, py, pz] = pose.position_m;
    const auto passed = now - track.at;
    const double could_m = std::min(kFarthestM, kFastestMS * std::chrono::duration<double>(passed).count());
    return passed < choices::kTrustLasts && std::hypot(px - x, py - y, pz - z) <= could_m;
  });
}

bool SolidLayer::covers(const Fingertip& tip, const Vector3& position_m) const {
  const auto [x, y, z] = position_m;
  const double reach = tip.shape == FingertipShape::kNode ? 3 * tip.footprint_m : reach_m(tip, y, 0);
  const auto inside = [reach](double at, double begin, double end, double around) {
    return at >= begin && at < end && at - reach > begin - around && at + reach < end + around;
  };
  return inside(x, region_.begin_x_m, region_.end_x_m, around_x_m_) &&
         inside(z, region_.z->begin_m, region_.z->end_m, around_z_m_);
}

void SolidLayer::require_covered(const Fingertip& tip, const TouchPose& pose) const {
  const auto [x, y, z] = pose.position_m;
  if (!covers(tip, pose.position_m))
    throw std::out_of_range(
        fmt::format("pose: at x {:.4g} m, z {:.4g} m the tip is beside the solid, which reaches from "
                    "{:.4g} to {:.4g} m along x "
                    "and from {:.4g} to {:.4g} m along z",
                    x, z, region_.begin_x_m, region_.end_x_m, region_.z->begin_m, region_.z->end_m));
}

ContactAnswer SolidLayer::answered(const Fingertip& tip, const TouchPose& pose) {
  require_covered(tip, pose);
  const std::uint64_t done = corrector_.done();
  {
    const std::lock_guard lock(last_mutex_);
    if (last_ && last_->done == done && last_->tip == tip && last_->position_m == pose.position_m)
      return last_->answer;  // made ready, then touched
  }
  Last last{tip, pose.position_m, done, contact_.felt_answer(tip, in_block(pose))};
  const std::lock_guard lock(last_mutex_);
  last_ = last;
  return std::move(last.answer);
}

void SolidLayer::correct(const Fingertip& tip, const TouchPose& pose) {
  if (!covers(tip, pose.position_m)) return;  // it leaves
  try {
    const SolveReport known = contact_.answer(tip, in_block(pose)).solve;
    if (settled(known)) return;
    const std::lock_guard lock(*mutex_);
    const double asked =
        std::clamp(kCorrected * known.relative_error, choices::kSolidForceError, kMaxCorrected);
    iterations_ += contact_.correct(tip, in_block(pose), asked).iterations;
  } catch (const std::out_of_range&) {  // said by the answer when the finger is there
  } catch (const std::invalid_argument&) {
  }
}

void SolidLayer::rethrow_of_device(const std::exception_ptr& failure) try {
  std::rethrow_exception(failure);
} catch (const DeviceMemoryError&) {
} catch (const DeviceError&) {
  corrector_.forget_failure();
  throw;
} catch (const std::exception&) {
}

}  // namespace teletact::service
