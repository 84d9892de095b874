#include "service/rpc/elastography_service.h"

#include "service/rpc/estimate_reactor.h"

namespace teletact::service {

grpc::ServerBidiReactor<v1::EstimateRequest, v1::EstimateResponse>* ElastographyService::Estimate(
    grpc::CallbackServerContext* context) {
  return EstimateReactor::serve(core_, context);
}

}  // namespace teletact::service
