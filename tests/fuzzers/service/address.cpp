// Addresses, as the command line and the configuration give them.
#include "service/rpc/address.h"

#include "tests/fuzzers/service/fuzzers.h"

namespace teletact::fuzzers {

bool address(Bytes bytes) {
  const std::string text = text_of(bytes);
  service::Address parsed;
  if (!accepted<std::runtime_error>([&] { parsed = service::parse_address("--listen", text); })) return false;
  require(parsed.socket.empty() != parsed.host.empty(), "neither a socket nor a host");
  const std::string written = parsed.host.empty() ? "unix://" + parsed.socket
                                                  : "[" + parsed.host + "]:" + std::to_string(parsed.port);
  const service::Address again = service::parse_address("--listen", written);
  require(again.socket == parsed.socket && again.host == parsed.host && again.port == parsed.port,
          "it is read back as another");
  return true;
}

}  // namespace teletact::fuzzers
