#include "service/rpc/elastography_service.h"

#include <spdlog/spdlog.h>

#include <utility>

#include "service/device/look.h"
#include "service/rpc/estimate_reactor.h"
#include "service/rpc/status.h"
#include "service/scene/errors.h"

namespace teletact::service {

namespace {

double worked_s() {
  return std::chrono::duration<double>(std::chrono::steady_clock::now().time_since_epoch()).count() -
         waited_s();
}

}  // namespace

ElastographyService::ElastographyService(Core& core, std::function<std::shared_ptr<Device>()> reopen,
                                         std::function<void(bool)> tell)
    : core_(core),
      reopen_(std::move(reopen)),
      engines_(core.device),
      recovery_([this] { open_again(); }, std::move(tell)) {
  core_.device.on_failure([this](const std::string& why) { recovery_.failed(why); });
}

void ElastographyService::warm() {
  core_.scenes.worker().run({}, [this] { engines_.borrow("")->warm(); }).future.get();
}

// A new device, tried by an estimate and by touch's kernels; then it is everybody's.
void ElastographyService::open_again() {
  const std::shared_ptr<Device> device = reopen_();
  core_.scenes.worker()
      .run({},
           [this, device] {
             engines_.use(device);
             engines_.borrow("")->warm();
             core_.models->warm(device);
           })
      .future.get();
  core_.device.replace(device);
}

grpc::ServerBidiReactor<v1::EstimateRequest, v1::EstimateResponse>* ElastographyService::Estimate(
    grpc::CallbackServerContext* context) {
  return EstimateReactor::serve(*this, context);
}

EstimateOutcome ElastographyService::work(const std::string& client, const EstimateRequest& r,
                                          const RfFrame& pre, const RfFrame& post,
                                          std::chrono::steady_clock::time_point received,
                                          const std::function<void(v1::EstimateStage)>& ended) try {
  recovery_.require();
  EstimateOutcome outcome;
  // What lies beside the window draws stress to itself: the scene tells what it knows of it by now.
  const KnownModulus known = r.scene ? known_modulus(r.scene->snapshot()->map) : KnownModulus{};
  {
    const auto engine = engines_.borrow(client);
    engine->charge_to(core_.account(client));
    engine->set_max_strain(r.max_strain);
    outcome.estimate = engine->estimate({pre, post, r.geometry, r.force, r.tissue, known, r.modulus},
                                        {[&](Stage stage) { ended(stage_to(stage)); }});
  }
  const teletact::service::Estimate& e = outcome.estimate;
  EstimateSeconds took{e.displacement_s + e.strain_s, e.modulus_s, 0};
  if (r.scene) {
    const double begun_s = worked_s();
    outcome.published = core_.scenes.publish(r.scene, window_of(r, e, received), client);
    took.publishing = outcome.publish_s = worked_s() - begun_s;
  }
  cost_.took(r.size(), took);
  return outcome;
} catch (const Error& error) {
  if (error.kind == ErrorKind::kDeadline) cost_.late();
  throw;
}

grpc::Status ElastographyService::status_of_work(std::exception_ptr error) {
  try {
    std::rethrow_exception(error);
  } catch (const TrackingError& e) {
    return {grpc::StatusCode::FAILED_PRECONDITION, e.what()};
  } catch (const DeviceMemoryError&) {  // says nothing of the device
    return status_of(error);
  } catch (const DeviceError& e) {
    recovery_.failed(e.what());
    return guarded([&] {
      recovery_.require();
      return status_of(error);
    });
  } catch (...) {
    return status_of(error);
  }
}

void ElastographyService::log_done(std::uint64_t call, const std::string& peer,
                                   const EstimateOutcome& outcome, std::chrono::duration<double> took) {
  const teletact::service::Estimate& e = outcome.estimate;
  spdlog::info(
      "event=estimate_done call={} peer={} valid={:.3f} correlation={:.3f} warnings={} elapsed_s={:.4f}",
      call, peer, e.valid_fraction, e.median_correlation, e.input_warnings.size() + e.modulus_warnings.size(),
      took.count());
  for (const std::string& warning : e.input_warnings)
    spdlog::warn("event=estimate_doubtful call={} flag=input text=\"{}\"", call, warning);
  for (const ModulusWarning& warning : e.modulus_warnings)
    spdlog::warn("event=estimate_doubtful call={} flag={} text=\"{}\"", call, name_of(warning.flag),
                 warning.text);
}

}  // namespace teletact::service
