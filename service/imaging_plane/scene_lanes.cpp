#include "service/imaging_plane/scene_lanes.h"

#include <spdlog/spdlog.h>

#include <algorithm>
#include <tuple>
#include <utility>

#include "service/scene/scene.h"

namespace teletact::service {

namespace {

// Of those that work only the ones with the fewest scenes still do. Load alone would put scenes whose first
// pairs come at once on one device: neither pair waits yet when the other is placed.
std::vector<SceneLanes::Lane> with_fewest(std::vector<SceneLanes::Lane> lanes, const auto& placed) {
  std::vector<std::size_t> scenes(lanes.size());
  for (const auto& [scene, at] : placed) ++scenes.at(at.lane);
  std::size_t fewest = placed.size();
  for (std::size_t k = 0; k < lanes.size(); ++k)
    if (lanes[k].works) fewest = std::min(fewest, scenes[k]);
  for (std::size_t k = 0; k < lanes.size(); ++k) lanes[k].works = lanes[k].works && scenes[k] == fewest;
  return lanes;
}

}  // namespace

std::size_t SceneLanes::least_loaded(const std::vector<Lane>& lanes) const {
  std::vector<std::size_t> scenes(lanes.size());
  for (const auto& [scene, at] : placed_) ++scenes.at(at.lane);
  const auto order = [&](std::size_t k) { return std::tuple(!lanes[k].works, lanes[k].load_s, scenes[k]); };
  std::size_t best = 0;
  for (std::size_t k = 1; k < lanes.size(); ++k)
    if (order(k) < order(best)) best = k;
  return best;
}

std::size_t SceneLanes::place(const std::shared_ptr<const Scene>& scene, const std::vector<Lane>& lanes) {
  const std::lock_guard lock(mutex_);
  std::erase_if(placed_, [](const auto& one) { return one.first.expired(); });
  if (!scene) return least_loaded(lanes);
  const auto found = placed_.find(scene);
  if (found != placed_.end() && lanes[found->second.lane].works) return found->second.lane;
  const std::size_t lane = least_loaded(with_fewest(lanes, placed_));
  const Place at{lane, lanes[lane].device};
  if (found == placed_.end()) {
    placed_.emplace(scene, at);
    spdlog::info("event=scene_placed scene={} device={}", scene->id(), at.device);
    return lane;
  }
  if (!lanes[lane].works) return found->second.lane;
  const Place before = std::exchange(found->second, at);
  ++moved_;
  spdlog::warn("event=scene_moved scene={} device={} from={}", scene->id(), at.device, before.device);
  return lane;
}

bool SceneLanes::is_at(const std::shared_ptr<const Scene>& scene, std::size_t device) const {
  const std::lock_guard lock(mutex_);
  const auto found = placed_.find(scene);
  return found != placed_.end() && found->second.device == device;
}

std::uint64_t SceneLanes::moved() const {
  const std::lock_guard lock(mutex_);
  return moved_;
}

}  // namespace teletact::service
