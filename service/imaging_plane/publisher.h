// What the imaging plane does to scenes: publishes windows, and has their neighbours rebuilt by themselves.
#pragma once

#include <chrono>
#include <condition_variable>
#include <map>
#include <memory>
#include <mutex>
#include <set>
#include <string>
#include <utility>

#include "service/imaging_plane/fair_workers.h"
#include "service/scene/scenes.h"

namespace teletact::service {

class Publisher {
 public:
  // The neighbours of a window that was published are fresh within this time, whatever else is worked on.
  static constexpr std::chrono::seconds kFreshWithin{1};
  // For another device's job to end that changes the scene.
  static constexpr std::chrono::milliseconds kPatience{10'000};

  explicit Publisher(Scenes& scenes, std::chrono::milliseconds patience = kPatience)
      : scenes_(scenes), patience_(patience) {}
  // On a thread of FairWorkers, else std::logic_error: publishes; the neighbours are then refreshed and the
  // scene is kept on disk by themselves, at the client's account. Throws Error(kUnavailable) where the
  // scene's former device hangs in the midst of a change.
  Published publish(const std::shared_ptr<Scene>&, const WindowEstimate&, const std::string& client);
  // So a slice of a solid, whose model is renewed by itself where it must be.
  Published publish(const std::shared_ptr<Scene>&, const ModulusSlice&, const std::string& client);

 private:
  class Changing;
  struct Changer {
    FairWorkers* workers;
    FairWorkers::Id job;
  };
  // Returns when nobody changes the scene but `changing`.
  void take_turn(const Scene&, Changing& changing);
  void let_end(const Scene&, const Changer&, FairWorkers::Clock::time_point patient_until);
  // Has `change` change the scene, alone, and sees to what follows.
  template <class Change>
  Published change(const std::shared_ptr<Scene>&, const std::string& client, const Change& change);
  void refresh_later(const std::shared_ptr<Scene>&, const JobTerms&);
  void refresh(const std::shared_ptr<Scene>&, JobTerms);
  Scenes& scenes_;
  const std::chrono::milliseconds patience_;
  std::mutex mutex_;
  // A background job of these waits for them: not one for all, since those of a device may hang.
  std::set<std::pair<const FairWorkers*, const Scene*>> refreshing_;
  // The job, which others may have made wait, that changes them.
  std::map<const Scene*, Changer> changing_;
  std::condition_variable changed_;
};

}  // namespace teletact::service
