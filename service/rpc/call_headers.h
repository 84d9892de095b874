// Calls from their headers on, before gRPC tells anybody of them: those that wait for a message, or are reset
// before it has come, are seen nowhere else.
#pragma once

#include <grpcpp/security/auth_context.h>
#include <grpcpp/security/server_credentials.h>
#include <grpcpp/server_context.h>

#include <memory>
#include <optional>
#include <string_view>

#include "service/rpc/connections.h"

namespace teletact::service {

// Of the connection that a call is of.
Connections::Identity identity_of(const grpc::AuthContext&);

// The credentials of connections that nobody encrypts. gRPC's own tell of no headers.
std::shared_ptr<grpc::ServerCredentials> clear_credentials();

// Each call of these credentials is told to `connections`, which live longer.
void count_headers(grpc::ServerCredentials&, Connections& connections);

// What the caller says in the metadata "traceparent"; none of one that says it twice. Valid as long as the
// context.
std::optional<std::string_view> traceparent_in(const grpc::ServerContextBase&);

}  // namespace teletact::service
