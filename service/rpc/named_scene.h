// The metadata "teletact-scene": by it a proxy sends all calls on a scene to the node that holds it.
#pragma once

#include <grpcpp/server_context.h>

#include <string>

namespace teletact::service {

// Throws std::invalid_argument where the call carries that metadata and `scene_id`, of its message, is
// another.
void require_named(const grpc::ServerContextBase&, const std::string& scene_id);

}  // namespace teletact::service
