#include "service/contact/solid_touch_model.h"

#include <fmt/format.h>
#include <spdlog/spdlog.h>

#include <algorithm>
#include <stdexcept>
#include <utility>

#include "service/base/choices.h"
#include "service/contact/plane_touch_model.h"
#include "service/contact/solid_contact.h"
#include "service/contact/solid_layer.h"
#include "service/device/device.h"

namespace teletact::service {

SolidTouchModel::SolidTouchModel(SolidBlock block, MemoryAccount account,
                                 const std::shared_ptr<SolidState>& before)
    : TouchModel(account, {.solid = std::make_shared<SolidState>()}), state_(made_of().solid) {
  validate(block.tissue);
  // The block and its copy that is touched, the factor while it is made, its shares of forces, and what
  // touches leave: 12 pairs of either friction.
  const SolidGrid& grid = block.tissue.grid;
  state_->charge = account.charge(Place::kHost, "solids", 95 * grid.elements() + 3250 * grid.columns());
  state_->block = std::move(block);
  state_->account = std::move(account);
  if (!before || take_over(*state_, *before, nullptr)) return;
  const std::lock_guard lock(before->mutex);
  // The oldest: what is begun of those between is not needed.
  state_->before = before->before ? before->before : before->rows[0].asked ? before : nullptr;
}

std::pair<std::shared_ptr<SolidNodes>, std::shared_ptr<Device>> SolidTouchModel::ready(const State& state) {
  const std::lock_guard lock(state.mutex);
  const Row& surface = state.rows.at(0);
  return {surface.kept, surface.device};
}

bool SolidTouchModel::take_over(State& state, const State& before,
                                const std::shared_ptr<Device>& wanted) try {
  const auto [former, device] = ready(before);
  if (!former || (wanted && wanted != device)) return false;
  auto made = std::make_shared<SolidNodes>(state.block, *former, state.account);
  const std::lock_guard lock(state.mutex);
  Row& surface = state.rows[0];
  surface.ready = surface.kept = std::move(made);
  surface.device = device;
  state.before.reset();
  return true;
} catch (const DeviceError&) {  // it has failed since: another one's time will come
  return false;
}

std::shared_ptr<SolidTouchModel::State> SolidTouchModel::being_made_before() const {
  const std::lock_guard lock(state_->mutex);
  return state_->before;
}

std::shared_ptr<const TouchModel> SolidTouchModel::renewed(const MemoryAccount& account) const {
  const auto [surface, device] = ready(*state_);
  if (!surface || !(surface->contact.drift().shape > choices::kMaxDrift)) return nullptr;
  auto fresh = std::make_shared<const SolidTouchModel>(state_->block, account);
  TouchWay way;
  way.device = device;
  fresh->layer(Layer{}, way, {});
  return fresh;
}

std::vector<Layer> SolidTouchModel::layers() const {
  return free_layers(state_->block.tissue.grid.y_m, Supports{});
}

std::string SolidTouchModel::plan() const {
  const Fingertip usual;
  const auto surface = ready(*state_).first;
  const auto shares = surface ? surface->contact.shares(usual) : nullptr;
  if (!shares) return "how its surface is touched is planned at the first touch";
  const double at_m = std::min(0.002, shares->max_m());
  const double off = shares->max_half_width(at_m);
  const Tolerance tolerance = usual_tolerance(state_->block.log_deviation);
  return fmt::format(
      "a round tip of {:.3g} mm is answered by log-weighted shares{}: at {:.2g} mm they may be off by up to "
      "{:.2g} %, where {:.2g} % or {:.2g} mN are allowed",
      1e3 * usual.radius_m, off <= tolerance.relative ? "" : " where they do, else by the nodes of the solid",
      1e3 * at_m, 100 * off, 100 * tolerance.relative, 1e3 * tolerance.force_n);
}

std::shared_ptr<TouchedLayer> SolidTouchModel::layer(const Layer& layer, const TouchWay& way,
                                                     const TouchWork& work) const {
  const std::vector<Layer> all = layers();
  const auto at = std::find(all.begin(), all.end(), layer);
  if (at == all.end())
    throw std::out_of_range(fmt::format("layer {} m deep: no row of nodes that is free", layer.depth_m));
  if (way.path == SolvePath::kCompliance)
    throw std::invalid_argument(
        "open.path: a solid has too many unknowns to be condensed; use auto or gradients");
  if (!way.device) throw DeviceError("solid tissue is solved on an OpenCL device, and there is none");
  const bool by_shares = way.path == SolvePath::kShares;
  const auto below = static_cast<std::size_t>(at - all.begin());
  if (by_shares && below > 0)
    throw std::invalid_argument(
        "open.path: below the surface a solid has no closed form; use auto or gradients");
  auto top = surface(way, work);
  if (top && below == 0 && way.path != SolvePath::kGradients && way.shares) {
    if (!SolidNodes::learned(top, work, way.client)) {
      const auto failure = top->not_learned();
      if (by_shares && failure) std::rethrow_exception(failure);
      if (by_shares || (top->follows_learned() && !failure)) return nullptr;
    }
  }
  if (top && below > 0)
    top = row(below, way, work, [top, below](const State& state) {
      return std::make_shared<SolidNodes>(*top, below, state.account);
    });
  return top ? std::make_shared<SolidLayer>(std::move(top), way, state_->block.log_deviation) : nullptr;
}

std::shared_ptr<SolidNodes> SolidTouchModel::surface(const TouchWay& way, const TouchWork& work) const {
  if (const auto before = being_made_before()) {
    if (take_over(*state_, *before, way.device)) return ready(*state_).first;
    const std::lock_guard lock(before->mutex);
    if (before->rows[0].asked) return nullptr;
  }
  return row(0, way, work, [device = way.device](const State& state) {
    return std::make_shared<SolidNodes>(state.block, device, state.account);
  });
}

std::shared_ptr<SolidNodes> SolidTouchModel::row(std::size_t index, const TouchWay& way,
                                                 const TouchWork& work, const Make& make) const {
  {
    const std::lock_guard lock(state_->mutex);
    Row& own = state_->rows[index];
    auto made = own.ready.lock();
    if (own.device == way.device && made) return made;
    if (own.asked) return nullptr;
    if (own.error && own.device == way.device && std::chrono::steady_clock::now() < own.retry)
      std::rethrow_exception(own.error);
    own.asked = true;
  }
  if (work) {
    work(way.client, [model = std::weak_ptr<State>(state_), index, device = way.device, make] {
      if (const auto state = model.lock()) make_ready(*state, index, device, make);  // else its scene is gone
    });
    return nullptr;
  }
  make_ready(*state_, index, way.device, make);
  const std::lock_guard lock(state_->mutex);
  const Row& own = state_->rows[index];
  if (own.error) std::rethrow_exception(own.error);
  return own.kept;
}

void SolidTouchModel::make_ready(State& state, std::size_t index, const std::shared_ptr<Device>& device,
                                 const Make& make) {
  std::shared_ptr<SolidNodes> made;
  std::exception_ptr error;
  try {
    made = make(state);
  } catch (const std::exception& e) {
    error = std::current_exception();
    spdlog::warn("event=solid_not_prepared row={} error=\"{}\"", index, e.what());
  }
  std::vector<std::shared_ptr<SolidNodes>> dropped;  // outside the lock: each waits for its correction
  const std::lock_guard lock(state.mutex);
  for (auto& [other, row] : state.rows)
    if (other == index || (index > 0 && other > 0)) dropped.push_back(std::exchange(row.kept, nullptr));
  Row& own = state.rows[index];
  own.device = device;
  own.ready = own.kept = std::move(made);
  own.asked = false;
  own.error = std::move(error);
  own.retry = std::chrono::steady_clock::now() + kRetry;
  if (index == 0) state.before.reset();
}

void warm_solids(const std::shared_ptr<Device>& device) {
  for (const auto& [nx, nz] : {std::pair<std::size_t, std::size_t>{64, 64}, {128, 64}, {64, 32}}) {
    SolidTissue tissue{{nx, nz, 0.002, 0.002, {0, 0.005, 0.010}}, {}, 0.49};
    for (std::size_t n = 0; n < tissue.grid.elements(); ++n)
      tissue.youngs_modulus_pa.push_back(n % nx < nx / 2 ? 1e4 : 2e4);
    SolidContact<float> contact(device->queue(), tissue);
    const double middle_m = tissue.grid.spacing_x_m * static_cast<double>(nx / 2);
    contact.correct({}, {middle_m, 0.001, middle_m}, choices::kLawShare);
    std::mutex solving;
    contact.learn_shares(device->queue(), solving);
  }
}

}  // namespace teletact::service
