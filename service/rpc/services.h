// The services of the contract, as gRPC takes them.
#pragma once

#include <grpcpp/impl/service_type.h>
#include <grpcpp/support/server_callback.h>

#include <memory>

#include "service/rpc/core.h"
#include "teletact/v1/palpation.pb.h"

namespace teletact::service {

namespace v1 = ::teletact::v1;

std::unique_ptr<grpc::Service> elastography_service(Core&);
std::unique_ptr<grpc::Service> info_service(Core&);
std::unique_ptr<grpc::Service> palpation_service(Core&);

// The latter's calls that last; each owns itself. `copying`: makes what is large.
grpc::ServerBidiReactor<v1::TouchRequest, v1::TouchResponse>* serve_touch(Core&,
                                                                          grpc::CallbackServerContext*);
grpc::ServerBidiReactor<v1::WatchFingerRequest, v1::FingerState>* serve_watch(Core&,
                                                                              grpc::CallbackServerContext*);
grpc::ServerBidiReactor<v1::ObserveRequest, v1::Observation>* serve_observe(Core&, Workers& copying,
                                                                            grpc::CallbackServerContext*);

}  // namespace teletact::service
