#include "bench/service.h"

#include <CLI/CLI.hpp>
#include <cstdio>

#include "bench/suite.h"
#include "client/link/channel.h"

namespace teletact::bench {

void add_service_options(CLI::App& command, Service& service) {
  command.add_option("--service", service.address, "HOST:PORT or unix:/path")->check(client::address_problem);
  for (const client::CredentialOption& option : client::credential_options(service.credentials))
    command.add_option_function<std::string>(option.flag, option.take, option.description);
}

std::shared_ptr<grpc::Channel> connect(const Service& service) {
  if (service.address.empty()) throw BenchError("give --service: the address of a running service");
  return client::reach_service(service.address, service.credentials,
                               [](const std::string& line) { std::fprintf(stderr, "%s\n", line.c_str()); });
}

}  // namespace teletact::bench
