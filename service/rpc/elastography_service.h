// RF pairs in, maps out.
#pragma once

#include "service/rpc/estimate_reactor.h"
#include "teletact/v1/elastography.grpc.pb.h"

namespace teletact::service {

class ElastographyService final : public v1::Elastography::CallbackService {
 public:
  explicit ElastographyService(Core& core) : core_(core) {}
  grpc::ServerBidiReactor<v1::EstimateRequest, v1::EstimateResponse>* Estimate(
      grpc::CallbackServerContext* context) override {
    return EstimateReactor::serve(core_, context);
  }

 private:
  Core& core_;
};

}  // namespace teletact::service
