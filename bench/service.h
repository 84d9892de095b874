// The running service that a suite is about, as its command line names it.
#pragma once

#include <grpcpp/channel.h>

#include <memory>
#include <string>

#include "client/link/credentials.h"

namespace CLI {
class App;
}

namespace teletact::bench {

struct Service {
  std::string address;
  client::Credentials credentials;
};

// Adds --service and how the two know each other; `service` must outlive the parsing.
void add_service_options(CLI::App& command, Service& service);

// Throws BenchError where --service was left out, or nobody answers there.
std::shared_ptr<grpc::Channel> connect(const Service&);

}  // namespace teletact::bench
