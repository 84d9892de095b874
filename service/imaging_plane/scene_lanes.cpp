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
  for (const auto& [scene, lane] : placed) ++scenes.at(lane);
  std::size_t fewest = placed.size();
  for (std::size_t k = 0; k < lanes.size(); ++k)
    if (lanes[k].works) fewest = std::min(fewest, scenes[k]);
  for (std::size_t k = 0; k < lanes.size(); ++k) lanes[k].works = lanes[k].works && scenes[k] == fewest;
  return lanes;
}

}  // namespace

std::size_t SceneLanes::least_loaded(const std::vector<Lane>& lanes) const {
  std::vector<std::size_t> scenes(lanes.size());
  for (const auto& [scene, lane] : lanes_) ++scenes.at(lane);
  const auto order = [&](std::size_t k) { return std::tuple(!lanes[k].works, lanes[k].load_s, scenes[k]); };
  std::size_t best = 0;
  for (std::size_t k = 1; k < lanes.size(); ++k)
    if (order(k) < order(best)) best = k;
  return best;
}

std::size_t SceneLanes::place(const std::shared_ptr<const Scene>& scene, const std::vector<Lane>& lanes) {
  const std::lock_guard lock(mutex_);
  std::erase_if(lanes_, [](const auto& one) { return one.first.expired(); });
  if (!scene) return least_loaded(lanes);
  const auto found = lanes_.find(scene);
  if (found == lanes_.end()) {
    const std::size_t lane = least_loaded(with_fewest(lanes, lanes_));
    lanes_.emplace(scene, lane);
    spdlog::info("event=scene_placed scene={} device={}", scene->id(), lane);
    return lane;
  }
  if (lanes[found->second].works) return found->second;
  const std::size_t other = least_loaded(with_fewest(lanes, lanes_));
  if (!lanes[other].works) return found->second;
  const std::size_t before = std::exchange(found->second, other);
  ++moved_;
  spdlog::warn("event=scene_moved scene={} device={} from={}", scene->id(), other, before);
  return other;
}

bool SceneLanes::is_at(const std::shared_ptr<const Scene>& scene, std::size_t lane) const {
  const std::lock_guard lock(mutex_);
  const auto found = lanes_.find(scene);
  return found != lanes_.end() && found->second == lane;
}

std::uint64_t SceneLanes::moved() const {
  const std::lock_guard lock(mutex_);
  return moved_;
}

}  // namespace teletact::service
