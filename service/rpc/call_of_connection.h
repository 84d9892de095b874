// One call as its connection counts it.
#pragma once

#include <grpcpp/server_context.h>
#include <grpcpp/support/server_interceptor.h>

#include <cstddef>
#include <memory>

#include "service/rpc/connections.h"

namespace teletact::service {

// Where the connection is none of those that are counted, a Unix socket's, nothing happens.
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

// Of the headers of a call together.
inline constexpr std::size_t kMaxHeaderBytes = 8 << 10;
// Throws Error(kExhausted) for more: gRPC announces it, and lets peers that have not confirmed so send what
// they like.
void require_short_headers(const grpc::ServerContextBase&);

}  // namespace teletact::service
