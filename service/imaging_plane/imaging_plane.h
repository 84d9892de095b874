// The imaging plane: RF pairs in, estimates out, windows published. Each device has its own turns
// (imaging_lane.h); a scene is imaged on one of them. Thread-safe.
#pragma once

#include <cstddef>
#include <deque>
#include <functional>
#include <memory>
#include <mutex>
#include <optional>
#include <string>
#include <vector>

#include "service/imaging_plane/imaging_lane.h"
#include "service/imaging_plane/scene_lanes.h"

namespace teletact::service {

// The modulus keeps one core at work, and the rest idle: a pair for each core but one, which is touch's,
// keeps a GPU at work, and one for each two cores a processor, whose kernels take them too.
// `cores`: of the machine, over its devices.
constexpr std::size_t kMostAtOnce = 16;
std::size_t usual_at_once(const DeviceInfo&, std::size_t cores);

class ImagingPlane {
 public:
  // `devices`: at least one; touch uses the first, too. `at_once`: how many pairs each works on; 0:
  // usual_at_once(). `reopen` opens the device of this number anew after it failed; `tell` is told whether
  // any works, on another thread.
  ImagingPlane(std::deque<CurrentDevice>& devices, std::size_t at_once, Scenes&,
               const std::shared_ptr<MemoryBudget>&, const std::shared_ptr<const TouchModels>&,
               const std::function<std::shared_ptr<Device>(std::size_t number)>& reopen,
               std::function<void(bool works)> tell);
  ~ImagingPlane() { stop(); }
  ImagingPlane(const ImagingPlane&) = delete;
  ImagingPlane& operator=(const ImagingPlane&) = delete;

  // Compiles the kernels.
  void warm();
  // Gives up what is worked on; nobody is told of the devices any more.
  void stop();
  // Throws Error(kUnavailable) with the remedy while no device works.
  void require_device() const;

  // Where it is to be estimated, and, in `asked`, in whose turns: those of its scene, one pair after the
  // other, since each is estimated beside what the ones before it have told.
  ImagingLane& lane_for(const EstimateRequest&, JobTerms& asked);
  // Makes a scene as Scenes::make. `made` is told with what became of it, once.
  Workers::Id make_scene(const std::string& id, const SceneGeometry&, std::optional<ExplicitModulus>,
                         const std::string& client, const Scenes::Made& made);
  // Publishes it. `told` what became of that, once.
  using Told = std::function<void(const Published&, std::exception_ptr)>;
  Workers::Id publish_slice(const std::shared_ptr<Scene>&, ModulusSlice, const std::string& client,
                            const Told& told);

  // Whose threads all of it is done on; a job is cancelled here.
  Workers& workers() { return workers_; }
  std::deque<ImagingLane>& lanes() { return lanes_; }
  // Scenes that another device took over.
  std::uint64_t scenes_moved() const { return places_.moved(); }

 private:
  ImagingLane& lane_for(const std::shared_ptr<const Scene>&, JobTerms& asked,
                        const std::function<double(const ImagingLane&)>& load_s);
  JobTerms placed(const std::shared_ptr<const Scene>&, const std::string& client);
  void tell(std::size_t number, bool works);
  Scenes& scenes_;
  std::mutex telling_;
  std::vector<bool> works_;
  const std::function<void(bool)> tell_;
  SceneLanes places_;
  std::vector<std::size_t> device_of_;  // by turns
  Workers workers_;
  Publisher publisher_;
  std::deque<ImagingLane> lanes_;  // last: their threads use the rest
};

}  // namespace teletact::service
