// Who calls. Work and memory are shared between clients: a client is the name that it gives in the metadata
// "teletact-client", on the host that it calls from; without a name it is the host.
#pragma once

#include <grpcpp/server_context.h>

#include <string>
#include <string_view>

namespace teletact::service {

// `peer` as gRPC says it: "ipv4:10.0.0.1:50051", "unix:/path".
std::string client_name(std::string_view name, std::string_view peer);
std::string client_of(const grpc::ServerContextBase&);

}  // namespace teletact::service
