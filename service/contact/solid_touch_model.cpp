#include "service/contact/solid_touch_model.h"

#include <fmt/format.h>
#include <spdlog/spdlog.h>

#include <stdexcept>
#include <utility>

#include "service/contact/solid_layer.h"
#include "service/device/device.h"

namespace teletact::service {

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
      std::make_shared<SolidLayer>(state.block, static_cast<const SolidLayer&>(*former), state.account);
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
  return surface ? static_cast<const SolidLayer&>(*surface).drift() : 0;
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
      made = std::make_shared<SolidLayer>(state->block, device, state->account);
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
