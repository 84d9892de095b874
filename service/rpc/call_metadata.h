// The metadata of a call. "teletact-client": work and memory are shared between clients, and a client is the
// name that it gives there, on the host that it calls from; without a name it is the host. "teletact-scene":
// by it a proxy sends all calls on a scene to the node that holds it.
#pragma once

#include <grpcpp/server_context.h>

#include <string>
#include <string_view>

namespace teletact::service {

// `peer` as gRPC says it: "ipv4:10.0.0.1:50051", "unix:/path".
std::string client_name(std::string_view name, std::string_view peer);
std::string client_of(const grpc::ServerContextBase&);

// Throws std::invalid_argument where the call carries that metadata and `scene_id`, of its message, is
// another.
void require_named(const grpc::ServerContextBase&, const std::string& scene_id);

}  // namespace teletact::service
