// The metadata of a call. "teletact-client": work and memory are shared between clients, and a client is the
// name that it gives there, on the host that it calls from; without a name it is the host. "teletact-scene":
// by it a proxy sends all calls on a scene to the node that holds it.
#pragma once

#include <grpcpp/server_context.h>

#include <cstddef>
#include <optional>
#include <string>
#include <string_view>

namespace teletact::service {

// `peer` as gRPC says it: "ipv4:10.0.0.1:50051", "unix:/path".
std::string client_name(std::string_view name, std::string_view peer);
std::string client_of(const grpc::ServerContextBase&);

// Throws std::invalid_argument where the call carries that metadata and `scene_id`, of its message, is
// another.
void require_named(const grpc::ServerContextBase&, const std::string& scene_id);

// What the caller says in the metadata "traceparent"; none of one that says it twice. Valid as long as the
// context.
std::optional<std::string_view> traceparent_in(const grpc::ServerContextBase&);

// Of the headers of a call together.
inline constexpr std::size_t kMaxHeaderBytes = 8 << 10;
// Throws Error(kExhausted) for more: gRPC announces it, and lets peers that have not confirmed so send what
// they like.
void require_short_headers(const grpc::ServerContextBase&);

}  // namespace teletact::service
