#include "service/contact/solid_touch_model.h"

#include <fmt/format.h>
#include <spdlog/spdlog.h>

#include <stdexcept>
#include <utility>

#include "service/contact/solid_contact.h"
#include "service/device/device.h"

namespace teletact::service {
namespace {

class SolidSurface final : public TouchedLayer {
 public:
  SolidSurface(const SolidBlock& block, const std::shared_ptr<Device>& device, const MemoryAccount& account)
      : region_(block.region),
        origin_x_m_(block.origin_x_m),
        origin_z_m_(block.origin_z_m),
        device_(device),
        contact_(device->queue(account), block.tissue) {}

  SolvePath path() const override { return SolvePath::kPcg; }

  // A step is a correction on the whole block.
  bool prepare(const Fingertip& tip, const TouchPose& pose, double, Clock::time_point until) override {
    if (pose.position_m[1] <= 0) return true;
    for (std::size_t corrections = 0;; ++corrections) {
      if (corrected(tip, pose, corrections > 0 ? 1 : 0).solve.converged) return true;
      if (Clock::now() >= until || corrections == choices::kMostCorrections) return false;
    }
  }

  ContactAnswer touch(const Fingertip& tip, const TouchPose& pose) override {
    ContactAnswer answer = corrected(tip, pose, choices::kMostCorrections);
    for (NodalPressure& p : answer.pressure) {
      p.position_m[0] += origin_x_m_;
      p.position_m[2] += origin_z_m_;
    }
    return answer;
  }

 private:
  ContactAnswer corrected(const Fingertip& tip, const TouchPose& pose, std::size_t most_corrections) {
    const auto [x, y, z] = pose.position_m;
    const auto inside = [](double at, double begin, double end) { return at >= begin && at < end; };
    if (!inside(x, region_.begin_x_m, region_.end_x_m) || !inside(z, region_.begin_z_m, region_.end_z_m))
      throw std::out_of_range(
          fmt::format("pose: x {:.4g} m, z {:.4g} m is beside the solid, which reaches from {:.4g} to {:.4g} "
                      "m along x and from "
                      "{:.4g} to {:.4g} m along z",
                      x, z, region_.begin_x_m, region_.end_x_m, region_.begin_z_m, region_.end_z_m));
    const std::lock_guard lock(mutex_);
    return contact_.touch(tip, {x - origin_x_m_, y, z - origin_z_m_}, {.most_corrections = most_corrections});
  }

  const Region region_;
  const double origin_x_m_, origin_z_m_;
  const std::shared_ptr<Device> device_;  // outlives its queue's arrays
  std::mutex mutex_;
  SolidContact<float> contact_;
};

}  // namespace

SolidTouchModel::SolidTouchModel(SolidBlock block, MemoryAccount account)
    : TouchModel(account), state_(std::make_shared<State>()) {
  validate(block.tissue);
  state_->block = std::move(block);
  state_->account = std::move(account);
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
  {
    const std::lock_guard lock(state_->mutex);
    if (state_->device == way.device && state_->ready) return state_->ready;
    if (state_->asked) return nullptr;
    if (state_->error && std::chrono::steady_clock::now() < state_->retry)
      std::rethrow_exception(state_->error);
    state_->asked = true;
  }
  const auto get_ready = [state = state_, device = way.device] {
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
