// Channels to the service, with a reconnect quicker than gRPC's own (which grows past one second).
#pragma once

#include <grpcpp/grpcpp.h>

#include <memory>
#include <string>

namespace teletact::client {

// `address` is "host:port" or "unix:/path". Connects lazily; backoff 50 to 200 ms. A channel shares no
// subchannel (and so no backoff) with any other.
std::shared_ptr<grpc::Channel> make_channel(const std::string& address);

// True once connected, false when `wait_s` has passed first.
bool wait_connected(grpc::Channel&, double wait_s);

// "NOT_FOUND: scene 'a' is unknown": the canonical code's name and the service's message.
std::string describe(const grpc::Status&);

}  // namespace teletact::client
