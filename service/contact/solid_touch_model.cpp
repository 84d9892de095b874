#include "service/contact/solid_touch_model.h"

#include <fmt/format.h>
#include <spdlog/spdlog.h>

#include <algorithm>
#include <atomic>
#include <cmath>
#include <deque>
#include <mutex>
#include <optional>
#include <stdexcept>
#include <utility>

#include "service/contact/corrector.h"
#include "service/contact/fingertip.h"
#include "service/contact/solid_contact.h"
#include "service/device/device.h"

namespace teletact::service {
namespace {

double around(double period_m, double begin_m, double end_m) {
  return (period_m - (end_m - begin_m)) / 2;
}

// A finger slower than this rests; one that would be faster, or is farther from where it was known, was put
// down elsewhere. A correction is as good as this share of what is stated where it is made: at most so
// coarse, a fast finger is soon elsewhere.
constexpr double kStillMS = 0.001, kFastestMS = 0.5, kFarthestM = 0.008, kCorrected = 0.2,
                 kMostCorrected = 0.01;

class SolidSurface final : public TouchedLayer {
 public:
  SolidSurface(const SolidBlock& block, const std::shared_ptr<Device>& device, const MemoryAccount& account)
      : region_(block.region),
        origin_x_m_(block.origin_x_m),
        origin_z_m_(block.origin_z_m),
        around_x_m_(around(static_cast<double>(block.tissue.grid.nx) * block.tissue.grid.spacing_x_m,
                           region_.begin_x_m, region_.end_x_m)),
        around_z_m_(around(static_cast<double>(block.tissue.grid.nz) * block.tissue.grid.spacing_z_m,
                           region_.begin_z_m, region_.end_z_m)),
        spacing_m_(std::max(block.tissue.grid.spacing_x_m, block.tissue.grid.spacing_z_m)),
        device_(device),
        mutex_(std::make_shared<std::mutex>()),
        contact_(device->queue(account), block.tissue) {}
  // Another modulus in the place of another's, solved with what that has. Ready while that is touched.
  SolidSurface(const SolidBlock& block, const SolidSurface& before, const MemoryAccount& account)
      : region_(before.region_),
        origin_x_m_(before.origin_x_m_),
        origin_z_m_(before.origin_z_m_),
        around_x_m_(before.around_x_m_),
        around_z_m_(before.around_z_m_),
        spacing_m_(before.spacing_m_),
        device_(before.device_),
        mutex_(before.mutex_),
        contact_(device_->queue(account), before.contact_, block.tissue) {}

  double drift() const { return contact_.drift().shape; }
  SolvePath path() const override { return SolvePath::kPcg; }

  // Corrections are made beside; none is waited for by a finger that is followed.
  bool prepare(const Fingertip& tip, const TouchPose& pose, double around_m,
               Clock::time_point until) override {
    if (pose.position_m[1] <= 0 || around_m > 0) return true;
    for (std::size_t corrections = 0;; ++corrections) {
      const std::uint64_t done = corrector_.done();
      if (settled(answered(tip, pose).solve) || follows(pose) || corrections == choices::kMostCorrections)
        return true;
      const std::exception_ptr failure = corrector_.failure();
      if (failure && corrections > 0) std::rethrow_exception(failure);  // it was waited for
      if (Clock::now() >= until) return false;
      corrector_.ask(tip, {pose.position_m});
      corrector_.wait_for_more_than(done, until + choices::kLongestSolve);  // one that is begun ends
    }
  }

  std::string remark(const Fingertip& tip, const TouchPose& pose) const override {
    return coarse_mesh(tip, pose.position_m[1], spacing_m_);
  }

  ContactAnswer touch(const Fingertip& tip, const TouchPose& pose) override {
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

  std::optional<std::vector<NodalPressure>> layered_pressure(const Fingertip& tip, const TouchPose& pose,
                                                             double force_n) const override {
    if (force_n <= 0) return std::vector<NodalPressure>{};
    auto pressure = contact_.layered_pressure(tip, in_block(pose), force_n);
    move_to_scene(pressure);
    return pressure;
  }

 private:
  Vector3 in_block(const TouchPose& pose) const {
    const auto [x, y, z] = pose.position_m;
    return {x - origin_x_m_, y, z - origin_z_m_};
  }
  void move_to_scene(std::vector<NodalPressure>& nodes) const {
    for (NodalPressure& p : nodes) {
      p.position_m[0] += origin_x_m_;
      p.position_m[2] += origin_z_m_;
    }
  }

  // What no correction makes better is settled too: the answer says what it is off by.
  static bool settled(const SolveReport& solve) { return solve.converged || solve.reason == kRoundingReason; }

  static bool good(const SolveReport& solve) {
    return settled(solve) || solve.relative_error - solve.of_model <= choices::kTrustedMeanwhile;
  }

  // Whether a finger that may have come from there was answered well a short time ago.
  bool follows(const TouchPose& pose) {
    const std::lock_guard lock(last_mutex_);
    return own_track(pose) != tracks_.end();
  }
  void follow(const TouchPose& pose) {
    const std::lock_guard lock(last_mutex_);
    if (const auto own = own_track(pose); own != tracks_.end()) tracks_.erase(own);
    tracks_.push_back({pose.position_m, Clock::now()});
    if (tracks_.size() > Corrector::kMostFingers) tracks_.pop_front();
  }
  struct Track {
    Vector3 position_m;
    Clock::time_point at;
  };
  std::deque<Track>::iterator own_track(const TouchPose& pose) {
    return std::ranges::find_if(tracks_, [&, now = Clock::now()](const Track& track) {
      const auto& [x, y, z] = track.position_m;
      const auto& [px, py, pz] = pose.position_m;
      const auto passed = now - track.at;
      const double could_m = std::min(kFarthestM, kFastestMS * std::chrono::duration<double>(passed).count());
      return passed < choices::kTrustLasts && std::hypot(px - x, py - y, pz - z) <= could_m;
    });
  }

  bool covers(const Fingertip& tip, const Vector3& position_m) const {
    const auto [x, y, z] = position_m;
    const double reach = tip.shape == FingertipShape::kNode ? 0 : reach_m(tip, y, 0);
    const auto inside = [reach](double at, double begin, double end, double around) {
      return at >= begin && at < end && at - reach > begin - around && at + reach < end + around;
    };
    return inside(x, region_.begin_x_m, region_.end_x_m, around_x_m_) &&
           inside(z, region_.begin_z_m, region_.end_z_m, around_z_m_);
  }

  // By what was learned up to now.
  ContactAnswer answered(const Fingertip& tip, const TouchPose& pose) {
    const auto [x, y, z] = pose.position_m;
    if (!covers(tip, pose.position_m))
      throw std::out_of_range(
          fmt::format("pose: at x {:.4g} m, z {:.4g} m the tip is beside the solid, which reaches from "
                      "{:.4g} to {:.4g} m along x "
                      "and from {:.4g} to {:.4g} m along z",
                      x, z, region_.begin_x_m, region_.end_x_m, region_.begin_z_m, region_.end_z_m));
    const std::uint64_t done = corrector_.done();
    {
      const std::lock_guard lock(last_mutex_);
      if (last_ && last_->done == done && last_->tip == tip && last_->position_m == pose.position_m)
        return last_->answer;  // made ready, then touched
    }
    Last last{tip, pose.position_m, done, contact_.answer(tip, in_block(pose))};
    const std::lock_guard lock(last_mutex_);
    last_ = last;
    return std::move(last.answer);
  }

  // By the corrector's thread.
  void correct(const Fingertip& tip, const TouchPose& pose) {
    if (!covers(tip, pose.position_m)) return;  // it leaves
    try {
      const SolveReport known = contact_.answer(tip, in_block(pose)).solve;
      if (settled(known)) return;
      const std::lock_guard lock(*mutex_);
      const double asked =
          std::clamp(kCorrected * known.relative_error, choices::kSolidForceError, kMostCorrected);
      iterations_ += contact_.correct(tip, in_block(pose), asked).iterations;
    } catch (const std::out_of_range&) {  // said by the answer when the finger is there
    } catch (const std::invalid_argument&) {
    }
  }

  // Others would fail as well, and another device may not. Once: the next touch tries again.
  void rethrow_of_device(const std::exception_ptr& failure) try {
    std::rethrow_exception(failure);
  } catch (const DeviceMemoryError&) {
  } catch (const DeviceError&) {
    corrector_.forget_failure();
    throw;
  } catch (const std::exception&) {
  }

  const Region region_;
  const double origin_x_m_, origin_z_m_;
  const double around_x_m_, around_z_m_;  // tissue on each side, up to where the other side's begins
  const double spacing_m_;
  const std::shared_ptr<Device> device_;     // outlives its queue's arrays
  const std::shared_ptr<std::mutex> mutex_;  // of all that share the solver
  SolidContact<float> contact_;              // corrected under the mutex
  struct Last {
    Fingertip tip;
    Vector3 position_m;
    std::uint64_t done;  // corrections by then
    ContactAnswer answer;
  };
  std::mutex last_mutex_;  // of these
  std::optional<Last> last_;
  std::deque<Track> tracks_;                 // of fingers that are followed
  std::atomic<std::size_t> iterations_ = 0;  // of corrections since the last answer
  Corrector corrector_{
      [this](const Fingertip& tip, const TouchPose& pose) { correct(tip, pose); }};  // ends first
};

}  // namespace

SolidTouchModel::SolidTouchModel(SolidBlock block, MemoryAccount account, const SolidTouchModel* before)
    : TouchModel(account), state_(std::make_shared<State>()) {
  validate(block.tissue);
  // The block and its copy that is touched, the factor while it is made, and what touches leave: 12 pairs of
  // either friction.
  const SolidGrid& grid = block.tissue.grid;
  state_->charge = account.charge(Place::kHost, "solids", 70 * grid.elements() + 3100 * grid.columns());
  state_->block = std::move(block);
  state_->account = std::move(account);
  if (!before || take_over(*state_, *before->state_, nullptr)) return;
  const std::lock_guard lock(before->state_->mutex);
  // The oldest: what is begun of those between is not needed.
  state_->before = before->state_->before  ? before->state_->before
                   : before->state_->asked ? before->state_
                                           : nullptr;
}

std::pair<std::shared_ptr<TouchedLayer>, std::shared_ptr<Device>> SolidTouchModel::ready(const State& state) {
  const std::lock_guard lock(state.mutex);
  return {state.ready, state.device};
}

bool SolidTouchModel::take_over(State& state, const State& before,
                                const std::shared_ptr<Device>& wanted) try {
  const auto [former, device] = ready(before);
  if (!former || (wanted && wanted != device)) return false;
  auto made =
      std::make_shared<SolidSurface>(state.block, static_cast<const SolidSurface&>(*former), state.account);
  const std::lock_guard lock(state.mutex);
  state.ready = std::move(made);
  state.device = device;
  state.before.reset();
  return true;
} catch (const DeviceError&) {  // it has failed since: another one's time will come
  return false;
}

std::shared_ptr<SolidTouchModel::State> SolidTouchModel::being_made_before() const {
  const std::lock_guard lock(state_->mutex);
  return state_->before;
}

double SolidTouchModel::drift() const {
  const auto surface = ready(*state_).first;
  return surface ? static_cast<const SolidSurface&>(*surface).drift() : 0;
}

std::shared_ptr<const SolidTouchModel> SolidTouchModel::renewed(const MemoryAccount& account) const {
  auto fresh = std::make_shared<const SolidTouchModel>(state_->block, account);
  TouchWay way;
  way.device = ready(*state_).second;
  fresh->layer(Layer{}, way, {});
  return fresh;
}

TouchCost SolidTouchModel::cost() const {
  // On the device: five fields, the transforms' spectrum, the factor of a quarter of the wave numbers, the
  // moduli. To get it ready: the factor of 3 x 3 blocks.
  const SolidGrid& grid = state_->block.tissue.grid;
  const std::size_t elements = grid.elements();
  return {elements * (5 * 3 + 4 + 4 + 1) * sizeof(float), 150.0 * static_cast<double>(elements)};
}

std::shared_ptr<TouchedLayer> SolidTouchModel::layer(const Layer& layer, const TouchWay& way,
                                                     const TouchWork& work) const {
  if (layer != Layer{})
    throw std::out_of_range(fmt::format("layer {} m deep: a solid is touched on its surface", layer.depth_m));
  if (way.path == SolvePath::kCompliance)
    throw std::invalid_argument("open.path: a solid has too many unknowns to be condensed; use auto or pcg");
  if (!way.device) throw DeviceError("solid tissue is solved on an OpenCL device, and there is none");
  if (const auto before = being_made_before()) {
    if (take_over(*state_, *before, way.device)) return ready(*state_).first;
    const std::lock_guard lock(before->mutex);
    if (before->asked) return nullptr;
  }
  {
    const std::lock_guard lock(state_->mutex);
    if (state_->device == way.device && state_->ready) return state_->ready;
    if (state_->asked) return nullptr;
    if (state_->error && state_->device == way.device && std::chrono::steady_clock::now() < state_->retry)
      std::rethrow_exception(state_->error);
    state_->asked = true;
  }
  const auto get_ready = [model = std::weak_ptr<State>(state_), device = way.device] {
    const std::shared_ptr<State> state = model.lock();
    if (!state) return;  // its scene is gone
    std::shared_ptr<TouchedLayer> made;
    std::exception_ptr error;
    try {
      made = std::make_shared<SolidSurface>(state->block, device, state->account);
    } catch (const std::exception& e) {
      error = std::current_exception();
      spdlog::warn("event=solid_not_prepared error=\"{}\"", e.what());
    }
    const std::lock_guard lock(state->mutex);
    state->device = device;
    state->ready = std::move(made);
    state->before.reset();
    state->asked = false;
    state->error = std::move(error);
    state->retry = std::chrono::steady_clock::now() + kRetry;
  };
  if (work) {
    work(way.client, get_ready);
    return nullptr;
  }
  get_ready();
  const std::lock_guard lock(state_->mutex);
  if (state_->error) std::rethrow_exception(state_->error);
  return state_->ready;
}

}  // namespace teletact::service
