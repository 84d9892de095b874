#include "service/imaging_plane/imaging_plane.h"

#include <spdlog/spdlog.h>

#include <algorithm>
#include <thread>
#include <utility>
#include <vector>

namespace teletact::service {

std::size_t usual_at_once(const DeviceInfo& device, std::size_t cores) {
  if (!device.gpu) cores = std::min<std::size_t>(cores, device.compute_units);
  return std::clamp<std::size_t>(device.gpu ? std::max<std::size_t>(cores, 1) - 1 : cores / 2, 1,
                                 kMostAtOnce);
}

ImagingPlane::ImagingPlane(std::deque<CurrentDevice>& devices, std::size_t at_once, Scenes& scenes,
                           const std::shared_ptr<MemoryBudget>& memory,
                           const std::shared_ptr<const TouchModels>& models,
                           const std::function<std::shared_ptr<Device>(std::size_t)>& reopen,
                           std::function<void(bool)> tell)
    : scenes_(scenes), works_(devices.size(), true), tell_(std::move(tell)), publisher_(scenes, workers_) {
  const std::size_t cores = std::thread::hardware_concurrency() / devices.size();
  // Each device's first turns before any's second.
  std::vector<std::vector<std::size_t>> turns(devices.size());
  for (std::size_t way = 0; way < kMostAtOnce; ++way)
    for (std::size_t k = 0; k < devices.size(); ++k)
      if (way < (at_once ? at_once : usual_at_once(devices[k]->info(), cores)))
        turns[k].push_back(device_of_.size()), device_of_.push_back(k);
  for (std::size_t k = 0; k < devices.size(); ++k)
    lanes_.emplace_back(k, devices[k], workers_, publisher_, memory,
                        ImagingLane::Options{turns[k], [reopen, k] { return reopen(k); },
                                             [this, k](bool works) { this->tell(k, works); },
                                             [models, k](const std::shared_ptr<Device>& device) {
                                               if (k == 0) models->warm(device);
                                             },
                                             [this, k](const std::shared_ptr<const Scene>& scene) {
                                               return lanes_.size() == 1 || places_.is_at(scene, k);
                                             }});
}

// The lanes' devices fail and come back on threads of their own.
void ImagingPlane::tell(std::size_t number, bool works) {
  const std::lock_guard lock(telling_);
  const auto any = [this] { return std::find(works_.begin(), works_.end(), true) != works_.end(); };
  const bool before = any();
  works_[number] = works;
  if (any() != before) tell_(works);
}

void ImagingPlane::warm() {
  std::vector<Workers::Running<void>> warming;
  for (ImagingLane& lane : lanes_) warming.push_back(lane.warm());
  for (auto& one : warming) one.future.get();
}

void ImagingPlane::stop() {
  workers_.stop();  // what runs ends at its next look
  for (ImagingLane& lane : lanes_) lane.stop();
}

void ImagingPlane::require_device() const {
  if (std::all_of(lanes_.begin(), lanes_.end(), [](const auto& lane) { return lane.failed(); }))
    lanes_.front().require_device();
}

ImagingLane& ImagingPlane::lane_for(const std::shared_ptr<const Scene>& scene, JobTerms& asked,
                                    const std::function<double(const ImagingLane&)>& load_s) {
  asked.device = 0;
  if (device_of_.size() == 1) return lanes_.front();
  std::vector<SceneLanes::Lane> lanes;
  for (const std::size_t device : device_of_) {
    lanes.push_back({lanes_[device].works(), load_s(lanes_[device]), device});
    ++asked.device;
  }
  asked.device = places_.place(scene, lanes);
  return lanes_[device_of_[asked.device]];
}

ImagingLane& ImagingPlane::lane_for(const EstimateRequest& request, JobTerms& asked) {
  const auto& scene = request.scene || !request.slice_of ? request.scene : request.slice_of->scene;
  return lane_for(scene, asked, [&](const ImagingLane& lane) { return lane.done_in_s(request, asked); });
}

// What is no estimate: nobody knows how long it takes.
JobTerms ImagingPlane::placed(const std::shared_ptr<const Scene>& scene, const std::string& client) {
  JobTerms terms{.client = client, .cost_s = Schedule::kSliceS};
  lane_for(scene, terms, [&](const ImagingLane&) { return workers_.done_in_s(terms); });
  terms.cost_s = 0;
  return terms;
}

Workers::Id ImagingPlane::make_scene(const std::string& id, const SceneGeometry& geometry,
                                     std::optional<ExplicitModulus> modulus, const std::string& client,
                                     const Scenes::Made& made) {
  return workers_.post(
      placed(nullptr, client),
      [this, id, geometry, modulus = std::move(modulus), client, made]() mutable {
        scenes_.make(id, geometry, std::move(modulus), made, client);
      },
      [made](const std::exception_ptr& error) {
        if (error) made(nullptr, error);
      });
}

Workers::Id ImagingPlane::publish_slice(const std::shared_ptr<Scene>& scene, ModulusSlice slice,
                                        const std::string& client, const Told& told) {
  const auto published = std::make_shared<Published>();
  return workers_.post(
      placed(scene, client),
      [this, scene, slice = std::move(slice), client, published] {
        *published = publisher_.publish(scene, slice, client);
      },
      [told, published](const std::exception_ptr& error) { told(*published, error); });
}

}  // namespace teletact::service
