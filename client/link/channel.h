// Channels to the service, with a reconnect quicker than gRPC's own (which grows past one second).
#pragma once

#include <grpcpp/grpcpp.h>

#include <chrono>
#include <deque>
#include <functional>
#include <memory>
#include <string>

#include "client/link/credentials.h"

namespace teletact::client {

// By which the service knows this process from other clients: host, process and a number, at most 64 bytes of
// printable ASCII. Every call over a channel of make_channel() carries it, as the metadata "teletact-client".
const std::string& client_name();

// What every channel is made with: fast reconnects, keepalive, message sizes; `proxy`: that of the
// environment.
grpc::ChannelArguments channel_arguments(bool proxy = false);

// `address` for gRPC: it would take the host of "dns:50051", or of any other of its schemes' names, for the
// scheme. "unix:50051" stays the path of a socket.
std::string grpc_target(const std::string& address);

// `address` is "host:port" or "unix:/path". Connects lazily; backoff 50 to 200 ms, 3 s per attempt. A channel
// shares no subchannel (and so no backoff) with any other. `name`: the client's, on every call. Throws as
// require_usable().
std::shared_ptr<grpc::Channel> make_channel(const std::string& address, const Credentials& credentials = {},
                                            const std::string& name = client_name());

// Reaches `address` over links that lose packets or say nothing: while an attempt hangs, another is started
// beside it every kAttemptS, and the first that succeeds is taken. One attempt alone would wait out its
// connect timeout, or TCP's own retries (1, 2, 4 s), after the link is back.
class Connecting {
 public:
  static constexpr double kAttemptS = 0.2;
  Connecting(std::string address, Credentials credentials);
  // A connected channel, or null when there is none after `wait_s`; then call again.
  std::shared_ptr<grpc::Channel> wait(double wait_s);

 private:
  static constexpr std::size_t kMaxAttempts = 15;  // each gets 3 s, enough for slow handshakes
  std::string address_;
  Credentials credentials_;
  std::deque<std::shared_ptr<grpc::Channel>> attempts_;
  std::chrono::steady_clock::time_point next_attempt_{};
};

// What is wrong with an address that a person gave, with the remedy; empty when it can be one.
std::string address_problem(const std::string& address);

// One line for a person: nobody serves at `address`, why that may be and what to do.
std::string nobody_answers(const std::string& address, const Credentials&);

// A channel to a service that serves. One that is starting (it listens before that, and compiles kernels and
// restores scenes meanwhile) is waited for, which `say` is told once, in a line. Throws std::runtime_error in
// one line when nobody answers for `connect_s`, when it has not begun to serve after a minute, or when it
// does not know who calls.
std::shared_ptr<grpc::Channel> reach_service(const std::string& address, const Credentials&,
                                             const std::function<void(const std::string&)>& say,
                                             double connect_s = 3);

// True once connected, false when `wait_s` has passed first.
bool wait_connected(grpc::Channel&, double wait_s);

// "NOT_FOUND: scene 'a' is unknown": the canonical code's name and the service's message.
std::string describe(const grpc::Status&);

}  // namespace teletact::client
