// Channels to the service, with a reconnect quicker than gRPC's own (which grows past one second).
#pragma once

#include <grpcpp/grpcpp.h>

#include <memory>
#include <string>

namespace teletact::client {

// `address` is "host:port" or "unix:/path". Connects lazily; backoff 50 to 200 ms. A channel shares no
// subchannel (and so no backoff) with any other. With `tls_ca`, PEM text, the connection is encrypted and the
// service must show a certificate that these authorities signed for the host's name ("localhost" for a Unix
// socket); without it nothing is encrypted.
std::shared_ptr<grpc::Channel> make_channel(const std::string& address, const std::string& tls_ca = "");

// The PEM text of --tls-ca FILE. Throws std::runtime_error with one line.
std::string read_tls_ca(const std::string& path);

// One line for a person: nobody serves at `address`, why that may be and what to do.
std::string nobody_answers(const std::string& address, const std::string& tls_ca);

// True once connected, false when `wait_s` has passed first.
bool wait_connected(grpc::Channel&, double wait_s);

// "NOT_FOUND: scene 'a' is unknown": the canonical code's name and the service's message.
std::string describe(const grpc::Status&);

}  // namespace teletact::client
