#include "bench/service.h"

#include "bench/suite.h"
#include "client/link/channel.h"

namespace teletact::bench {

void add_service_options(CLI::App& command, Service& service) {
  command.add_option("--service", service.address, "HOST:PORT or unix:/path")->check(client::address_problem);
  command.add_option_function<std::string>(
      "--tls-ca", [&service](const std::string& path) { service.tls_ca = client::read_tls_ca(path); },
      "PEM certificate that signed the service's");
}

void require_named(const Service& service) {
  if (service.address.empty()) throw BenchError("give --service: the address of a running service");
}

}  // namespace teletact::bench
