// What the imaging plane does to scenes: publishes windows, and has their neighbours rebuilt by themselves.
#pragma once

#include <chrono>
#include <map>
#include <memory>
#include <mutex>
#include <set>
#include <string>

#include "service/imaging_plane/fair_workers.h"
#include "service/scene/scenes.h"

namespace teletact::service {

class Publisher {
 public:
  // The neighbours of a window that was published are fresh within this time, whatever else is worked on.
  static constexpr std::chrono::seconds kFreshWithin{1};

  explicit Publisher(Scenes& scenes) : scenes_(scenes) {}
  // On one of its workers, else std::logic_error: publishes; the neighbours are then refreshed and the scene
  // is kept on disk by themselves, at the client's account.
  Published publish(const std::shared_ptr<Scene>&, const WindowEstimate&, const std::string& client);
  // So a slice of a solid, whose model is renewed by itself where it must be.
  Published publish(const std::shared_ptr<Scene>&, const ModulusSlice&, const std::string& client);
  FairWorkers& workers() { return workers_; }

 private:
  class Changing;
  // Has `change` change the scene, alone, and sees to what follows.
  template <class Change>
  Published change(const std::shared_ptr<Scene>&, const std::string& client, const Change& change);
  void refresh_later(const std::shared_ptr<Scene>&, const JobTerms&);
  void refresh(const std::shared_ptr<Scene>&, JobTerms);
  Scenes& scenes_;
  std::mutex mutex_;
  std::set<const Scene*> refreshing_;  // a background job waits for them
  // The job, which others may have made wait, that changes them.
  std::map<const Scene*, FairWorkers::Id> changing_;
  FairWorkers workers_;  // last: its jobs use all of the above
};

}  // namespace teletact::service
