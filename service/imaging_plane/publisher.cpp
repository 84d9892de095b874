#include "service/imaging_plane/publisher.h"

#include <spdlog/spdlog.h>

#include <optional>

#include "service/device/cancellation.h"
#include "service/scene/errors.h"

namespace teletact::service {

// A scene is changed by one job at a time. One that is made to wait in the midst of it must get its turn
// before another may wait for the scene itself.
class Publisher::Changing {
 public:
  Changing(Publisher& publisher, const Scene& scene) : publisher_(publisher), scene_(scene) {}
  ~Changing() {
    if (!begun_) return;
    {
      const std::lock_guard lock(publisher_.mutex_);
      publisher_.changing_.erase(&scene_);
    }
    publisher_.changed_.notify_all();
  }
  // Nothing, or the job that changes it now.
  std::optional<Changer> begin() {
    FairWorkers& here = FairWorkers::here();
    const Changer changer{&here, here.current()};
    const std::lock_guard lock(publisher_.mutex_);
    const auto [at, first] = publisher_.changing_.emplace(&scene_, changer);
    begun_ = first;
    return first ? std::nullopt : std::optional(at->second);
  }

 private:
  Publisher& publisher_;
  const Scene& scene_;
  bool begun_ = false;
};

namespace {

constexpr std::chrono::milliseconds kSoon{100};

void log_failure(const std::string& scene, const std::exception_ptr& error) {
  try {
    std::rethrow_exception(error);
  } catch (const Error&) {  // given up: the service ends
  } catch (const std::exception& e) {
    spdlog::error("event=refresh_failed scene={} error=\"{}\"", scene, e.what());
  }
}

}  // namespace

void Publisher::take_turn(const Scene& scene, Changing& changing) {
  const auto patient_until = FairWorkers::Clock::now() + patience_;
  while (const auto other = changing.begin()) let_end(scene, *other, patient_until);
}

// Another device's job, of before the scene was moved from there, goes on beside this one, or hangs.
void Publisher::let_end(const Scene& scene, const Changer& other,
                        FairWorkers::Clock::time_point patient_until) {
  constexpr std::chrono::milliseconds kLook{10};
  FairWorkers& here = FairWorkers::here();
  if (other.workers == &here) return here.step_aside(other.job);
  if (FairWorkers::Clock::now() > patient_until) {
    spdlog::error("event=scene_held scene={} by=\"a job of its former device\"", scene.id());
    throw Error(ErrorKind::kUnavailable,
                "the scene's former device has not ended its change of the scene; send it again, and if that "
                "does not help, restart the service");
  }
  {
    std::unique_lock lock(mutex_);
    changed_.wait_for(lock, kLook, [&] { return !changing_.contains(&scene); });
  }
  check_cancelled();
}

template <class Change>
Published Publisher::change(const std::shared_ptr<Scene>& scene, const std::string& client,
                            const Change& change) {
  Published published = [&] {
    Changing changing(*this, *scene);
    take_turn(*scene, changing);
    return change();
  }();
  if (scenes_.trouble_with_disk())
    published.warnings.emplace_back(
        "state: the disk does not take it, and a restart of the service would lose it; the service's log "
        "says why");
  scenes_.keep_later(scene);
  JobTerms terms;
  terms.client = client;
  terms.deadline = FairWorkers::Clock::now() + kFreshWithin;
  terms.owed = true;
  refresh_later(scene, terms);
  return published;
}

Published Publisher::publish(const std::shared_ptr<Scene>& scene, const WindowEstimate& estimate,
                             const std::string& client) {
  const Published published = change(scene, client, [&] {
    return scene->publish(estimate, [] {
      check_cancelled();
      return false;
    });
  });
  spdlog::info("event=window_published scene={} window={} version={} begin_m={:.6f} width_m={:.6f}",
               scene->id(), published.window_id, published.version, estimate.window_x_m, estimate.width_m);
  return published;
}

Published Publisher::publish(const std::shared_ptr<Scene>& scene, const ModulusSlice& slice,
                             const std::string& client) {
  const Published published = change(scene, client, [&] { return scene->publish(slice); });
  spdlog::info("event=slice_published scene={} version={} z_m={:.6f}", scene->id(), published.version,
               slice.z_m);
  return published;
}

void Publisher::refresh_later(const std::shared_ptr<Scene>& scene, const JobTerms& terms) {
  {
    const std::lock_guard lock(mutex_);
    if (!refreshing_.emplace(&FairWorkers::here(), scene.get()).second)
      return;  // the job that waits will see the newest
  }
  try {
    FairWorkers::here().post(
        terms,
        [this, scene, terms] {
          {
            const std::lock_guard lock(mutex_);
            refreshing_.erase({&FairWorkers::here(), scene.get()});
          }
          refresh(scene, terms);
        },
        [id = scene->id()](const std::exception_ptr& error) {
          if (error) log_failure(id, error);
        });
  } catch (const Error&) {  // the service ends: nobody will touch it
  }
}

// One window for each job: a new estimate goes before the rest, until they are due.
void Publisher::refresh(const std::shared_ptr<Scene>& scene, JobTerms terms) {
  const auto begun = FairWorkers::Clock::now();
  if (const auto renewed = scene->renewed()) {  // while slices come
    Changing changing(*this, *scene);
    take_turn(*scene, changing);
    scene->renew(*renewed);
    return scenes_.keep_later(scene);
  }
  bool more = false;
  {
    Changing changing(*this, *scene);
    if (changing.begin()) {  // soon: who changes it needs a turn for that
      terms.deadline = begun + kSoon;
      terms.cost_s = 0;
      return refresh_later(scene, terms);
    }
    more = scene->refresh_stale_window();
  }
  scenes_.keep_later(scene);
  if (!more) return;
  terms.cost_s = std::chrono::duration<double>(FairWorkers::Clock::now() - begun).count();
  refresh_later(scene, terms);
}

}  // namespace teletact::service
