// RF pairs in, maps out, windows published.
#pragma once

#include <chrono>
#include <exception>
#include <functional>
#include <memory>
#include <string>

#include "service/imaging/engines.h"
#include "service/imaging/estimate_cost.h"
#include "service/rpc/client.h"
#include "service/rpc/core.h"
#include "service/rpc/device_recovery.h"
#include "service/rpc/estimate_answer.h"
#include "teletact/v1/elastography.grpc.pb.h"

namespace teletact::service {

class ElastographyService final : public v1::Elastography::CallbackService {
 public:
  // `reopen` opens the device anew after it failed; `tell` is told whether it works.
  ElastographyService(Core&, std::function<std::shared_ptr<Device>()> reopen,
                      std::function<void(bool works)> tell);
  // Compiles the kernels, on the imaging plane.
  void warm();
  grpc::ServerBidiReactor<v1::EstimateRequest, v1::EstimateResponse>* Estimate(
      grpc::CallbackServerContext*) override;

  // Once the imaging plane has stopped: nobody is told of the device any more.
  void close() { recovery_.stop(); }

  // For its calls.
  Core& core() { return core_; }
  EstimateCost& cost() { return cost_; }
  const DeviceRecovery& device() const { return recovery_; }
  // On the imaging plane. `received`: when the pair came in.
  EstimateOutcome work(const std::string& client, const EstimateRequest&, const RfFrame& pre,
                       const RfFrame& post, std::chrono::steady_clock::time_point received,
                       const std::function<void(v1::EstimateStage)>& ended);
  // Of work that threw. A device that failed is seen to.
  grpc::Status status_of_work(std::exception_ptr);
  static void log_done(std::uint64_t call, const std::string& peer, const EstimateOutcome&,
                       std::chrono::duration<double> took);

 private:
  void open_again();
  Core& core_;
  const std::function<std::shared_ptr<Device>()> reopen_;
  EstimateCost cost_;
  Engines engines_;
  DeviceRecovery recovery_;  // last: its thread uses the rest
};

}  // namespace teletact::service
