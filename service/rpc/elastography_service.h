// RF pairs in, maps out.
#pragma once

#include "service/rpc/core.h"
#include "teletact/v1/elastography.grpc.pb.h"

namespace teletact::service {

namespace v1 = ::teletact::v1;

class ElastographyService final : public v1::Elastography::CallbackService {
 public:
  explicit ElastographyService(Core& core) : core_(core) {}
  grpc::ServerBidiReactor<v1::EstimateRequest, v1::EstimateResponse>* Estimate(
      grpc::CallbackServerContext*) override;

 private:
  Core& core_;
};

}  // namespace teletact::service
