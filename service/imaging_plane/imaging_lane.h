// One device of the imaging plane: what is estimated on it and when, how long that takes, and how the device
// comes back when it fails. Its jobs take turns (service/scene/schedule.h), below touch; a device that idles
// while a processor works on one pair has several turns at once. Thread-safe.
#pragma once

#include <atomic>
#include <chrono>
#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "service/device/current_device.h"
#include "service/imaging/engines.h"
#include "service/imaging_plane/device_recovery.h"
#include "service/imaging_plane/estimate_cost.h"
#include "service/imaging_plane/estimate_request.h"
#include "service/imaging_plane/publisher.h"

namespace teletact::service {

struct EstimateOutcome {
  Estimate estimate;
  std::optional<Published> published;
  // waited_s: of the time since the upload, while others had their turn.
  double publish_s = 0, received_to_published_s = 0, queued_s = 0, waited_s = 0;
};

class ImagingLane {
 public:
  using Clock = std::chrono::steady_clock;
  using Frames = std::pair<RfFrame, RfFrame>;  // pre and post
  // Without a look for so long, its device hangs: at most 50 ms of work lie between two (cancellation.h).
  static constexpr double kStalledS = 10;

  // `turns`: whose jobs run at once on it, by JobTerms::device. `reopen` opens it anew after it failed;
  // `tell` is told whether it works, on another thread; `warm` compiles what touch uses of it; `images`:
  // whether a scene is imaged here, and not on another device meanwhile.
  struct Options {
    std::vector<std::size_t> turns;
    std::function<std::shared_ptr<Device>()> reopen;
    std::function<void(bool works)> tell;
    std::function<void(const std::shared_ptr<Device>&)> warm;
    std::function<bool(const std::shared_ptr<const Scene>&)> images;
  };
  // `workers` are all devices'; they are stopped before this ends.
  ImagingLane(std::size_t number, CurrentDevice& device, Workers& workers, Publisher&,
              std::shared_ptr<MemoryBudget>, Options);

  // Compiles the kernels; `future` is ready when that is done.
  Workers::Running<void> warm();
  // Nobody is told of the device any more.
  void stop() { recovery_.stop(); }
  bool works() const;
  // From now on it hangs after so long, and not after kStalledS.
  void hangs_after(double silent_s) { stalled_s_ = silent_s; }
  // Throws Error(kUnavailable) with the remedy while the device does not work.
  void require_device() const { recovery_.require(); }
  bool failed() const { return !recovery_.works(); }

  // `asked`, here and below: the client, whose turns it takes (ImagingPlane::lane_for), and the deadline of
  // its call, which the request may bring forward. By when one would be done, were it posted now, that takes
  // as long on every device.
  double done_in_s(const EstimateRequest&, const JobTerms& asked) const;
  // Before the upload: throws Error(kDeadline) for an estimate that even alone could not be done in time.
  void refuse_the_hopeless(const EstimateRequest&, const JobTerms& asked);
  // After it: the terms on which estimate() is to be posted to the workers. Throws Error(kDeadline) for one
  // that beside the others could not be done in time.
  JobTerms admit(const EstimateRequest&, const JobTerms& asked);
  // On one of the workers, on terms that admit() gave. `received`: when the last byte came; `frames`: pre and
  // post, asked for once. `ended` is told each stage. What it throws, a device that fails among it, is seen
  // to.
  EstimateOutcome estimate(const EstimateRequest&, const JobTerms&, Clock::time_point received,
                           const std::function<Frames()>& frames, const std::function<void(Stage)>& ended);

  // That jobs were at work with it, in the mean of its turns, of the time since the start.
  double busy_s() const;

 private:
  void open_again();
  // On its first turns.
  JobTerms any() const { return {.client = {}, .device = options_.turns.front()}; }
  JobTerms terms(const EstimateRequest&, const JobTerms& asked) const;
  // The least that it could work, s: by the quickest method where none is named.
  double min_s(const EstimateRequest&) const;
  ModulusBudget modulus_budget(const EstimateRequest&, const JobTerms&, double begun_s) const;
  // Throws Error(kUnavailable) for what would be published in a scene that another device took over.
  void require_here(const EstimateRequest&) const;
  // Throws Error(kDeadline) with `words`, which show in how long it could be done, unless that is in time.
  void require_in_time(const EstimateRequest&, const JobTerms&, double done_in_s, const char* words);
  EstimateOutcome work(const EstimateRequest&, const JobTerms&, Clock::time_point received,
                       const Frames& frames, const std::function<void(Stage)>& ended);
  CurrentDevice& device_;
  Workers& workers_;
  Publisher& publisher_;
  const std::shared_ptr<MemoryBudget> memory_;
  const Options options_;
  std::atomic<double> stalled_s_{kStalledS};
  EstimateCost cost_;
  Engines engines_;
  DeviceRecovery recovery_;  // last: its thread uses the rest
};

}  // namespace teletact::service
