#include "service/imaging_plane/publisher.h"

#include <spdlog/spdlog.h>

#include "service/device/cancellation.h"
#include "service/scene/errors.h"

namespace teletact::service {

namespace {

void log_failure(const std::string& scene, const std::exception_ptr& error) {
  try {
    std::rethrow_exception(error);
  } catch (const Error&) {  // given up: the service ends
  } catch (const std::exception& e) {
    spdlog::error("event=refresh_failed scene={} error=\"{}\"", scene, e.what());
  }
}

}  // namespace

void Publisher::change_alone(const Scene& scene, const std::function<void()>& change) {
  if (workers_.do_alone(&scene, patience_, change)) return;
  spdlog::error("event=scene_held scene={} by=\"a job of its former device\"", scene.id());
  throw Error(ErrorKind::kUnavailable,
              "the scene's former device has not ended its change of the scene; send it again, and if that "
              "does not help, restart the service");
}

Published Publisher::change(const std::shared_ptr<Scene>& scene, const std::string& client,
                            std::chrono::seconds within, const std::function<Published()>& change) {
  Published published;
  change_alone(*scene, [&] { published = change(); });
  if (scenes_.trouble_with_disk())
    published.warnings.push_back(
        Warning{WarningFlag::kState,
                "the disk does not take it, and a restart of the service would lose it; the service's log "
                "says why"}
            .line());
  scenes_.keep_later(scene);
  refresh_later(scene, {.client = client,
                        .deadline = Workers::Clock::now() + within,
                        .owed = true,
                        .device = workers_.device_here()});
  return published;
}

Published Publisher::publish(const std::shared_ptr<Scene>& scene, const WindowEstimate& estimate,
                             const std::string& client) {
  const Published published = change(scene, client, kFreshWithin, [&] { return scene->publish(estimate); });
  spdlog::info("event=window_published scene={} window={} version={} begin_m={:.6f} width_m={:.6f}",
               scene->id(), published.window_id, published.version, estimate.window_x_m, estimate.width_m);
  return published;
}

Published Publisher::publish(const std::shared_ptr<Scene>& scene, const ModulusSlice& slice,
                             const std::string& client) {
  const Published published = change(scene, client, kRenewedWithin, [&] { return scene->publish(slice); });
  spdlog::info("event=slice_published scene={} version={} z_m={:.6f}", scene->id(), published.version,
               slice.z_m);
  return published;
}

void Publisher::refresh_later(const std::shared_ptr<Scene>& scene, const JobTerms& terms) {
  const std::pair of(terms.device, scene.get());
  {
    const std::lock_guard lock(mutex_);
    if (!refreshing_.insert(of).second) return;  // the job that waits will see the newest
  }
  try {
    workers_.post(
        terms,
        [this, scene, terms, of] {
          {
            const std::lock_guard lock(mutex_);
            refreshing_.erase(of);
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
  const double begun_s = worked_s();
  bool more = false;
  const auto renewed = scene->renewed();  // while slices come
  const bool changed = workers_.do_alone(scene.get(), patience_, [&] {
    if (renewed)
      scene->renew(*renewed);
    else
      more = scene->refresh_stale_window();
  });
  if (!changed) return refresh_later(scene, terms);  // its former device hangs: until it does not
  scenes_.keep_later(scene);
  if (!more) return;
  terms.cost_s = worked_s() - begun_s;
  refresh_later(scene, terms);
}

}  // namespace teletact::service
