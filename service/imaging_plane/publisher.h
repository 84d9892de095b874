// What the imaging plane does to scenes: publishes windows, and has their neighbours rebuilt by themselves.
#pragma once

#include <chrono>
#include <functional>
#include <memory>
#include <mutex>
#include <set>
#include <string>
#include <utility>

#include "service/scene/scenes.h"
#include "service/scene/workers.h"

namespace teletact::service {

class Publisher {
 public:
  // The neighbours of a window that was published are fresh within this time, whatever else is worked on.
  static constexpr std::chrono::seconds kFreshWithin{1};
  // A solid's model that slices have worn is renewed within this, between estimates where these leave time:
  // what it is off by until then is stated (T8.7), and whoever waits for the next slice does not wait for it.
  static constexpr std::chrono::seconds kRenewedWithin{10};
  // For another device's job to end that changes the scene.
  static constexpr std::chrono::milliseconds kPatience{10'000};

  Publisher(Scenes& scenes, Workers& workers, std::chrono::milliseconds patience = kPatience)
      : scenes_(scenes), workers_(workers), patience_(patience) {}
  // On a thread of the workers, else std::logic_error: publishes; the neighbours are then refreshed and the
  // scene is kept on disk by themselves, at the client's account. Throws Error(kUnavailable) where the
  // scene's former device hangs in the midst of a change.
  Published publish(const std::shared_ptr<Scene>&, const WindowEstimate&, const std::string& client);
  // So a slice of a solid, whose model is renewed by itself where it must be.
  Published publish(const std::shared_ptr<Scene>&, const ModulusSlice&, const std::string& client);

 private:
  // Has `change` change the scene, and no other job meanwhile: one that made way in the midst of it goes on
  // before another may.
  void change_alone(const Scene&, const std::function<void()>& change);
  // The same, and sees to what follows, within that time.
  Published change(const std::shared_ptr<Scene>&, const std::string& client, std::chrono::seconds within,
                   const std::function<Published()>& change);
  void refresh_later(const std::shared_ptr<Scene>&, const JobTerms&);
  void refresh(const std::shared_ptr<Scene>&, JobTerms);
  Scenes& scenes_;
  Workers& workers_;
  const std::chrono::milliseconds patience_;
  std::mutex mutex_;
  // A background job of these waits for them: not one for all, since those of a device may hang.
  std::set<std::pair<std::size_t, const Scene*>> refreshing_;
};

}  // namespace teletact::service
