// Calls as their connections count them, from their headers on, before gRPC tells anybody of them: those that
// wait for a message, or are reset before it has come, are seen nowhere else.
#pragma once

#include <grpcpp/security/auth_context.h>
#include <grpcpp/security/server_credentials.h>
#include <grpcpp/server_context.h>
#include <grpcpp/support/server_interceptor.h>

#include <cstddef>
#include <memory>

#include "service/rpc/connections.h"

namespace teletact::service {

// Of the connection that a call is of.
Connections::Identity identity_of(const grpc::AuthContext&);

// The credentials of connections that nobody encrypts. gRPC's own tell of no headers.
std::shared_ptr<grpc::ServerCredentials> clear_credentials();

// Each call of these credentials is told to `connections`, which live longer.
void count_headers(grpc::ServerCredentials&, Connections& connections);

// One call of a connection. Where that is none of those that are counted, a Unix socket's, nothing happens.
class CallOfConnection {
 public:
  // `counts`: it is open while this lives. Calls that begin with a message are counted by CountCalls: one
  // that is reset before that has come is told to nobody else.
  CallOfConnection(Connections& connections, const grpc::ServerContextBase& context, bool counts)
      : connections_(connections),
        context_(context),
        connection_(connections.of(context.peer())),
        counts_(counts) {
    if (connection_ && counts_) connection_->begun();
  }
  ~CallOfConnection() {
    if (connection_ && counts_) connection_->ended();
  }
  CallOfConnection(const CallOfConnection&) = delete;
  CallOfConnection& operator=(const CallOfConnection&) = delete;
  // It came to nothing.
  void waste() {
    if (connection_) connection_->wasted();
  }
  // Its caller may make it.
  void vouch();
  // As CountedConnection's; never, where it is not counted.
  CountedConnection::Clock::time_point late_at() const {
    return connection_ ? connection_->late_at() : CountedConnection::Clock::time_point{};
  }

 private:
  Connections& connections_;
  const grpc::ServerContextBase& context_;
  const std::shared_ptr<CountedConnection> connection_;
  const bool counts_;
};

// Counts calls of one request, from their headers on.
class CountCalls final : public grpc::experimental::ServerInterceptorFactoryInterface {
 public:
  explicit CountCalls(Connections& connections) : connections_(connections) {}
  grpc::experimental::Interceptor* CreateServerInterceptor(grpc::experimental::ServerRpcInfo*) override;

 private:
  Connections& connections_;
};

}  // namespace teletact::service
