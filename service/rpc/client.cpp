#include "service/rpc/client.h"

#include "service/scene/errors.h"

namespace teletact::service {

std::string client_name(std::string_view name, std::string_view peer) {
  const std::size_t scheme = peer.find(':'), port = peer.rfind(':');
  const bool on_network = peer.starts_with("ipv4:") || peer.starts_with("ipv6:");
  const std::string_view host =
      on_network && port > scheme ? peer.substr(scheme + 1, port - scheme - 1) : std::string_view("local");
  return name.empty() ? std::string(host) : shown(name) + "@" + std::string(host);
}

std::string client_of(const grpc::ServerContextBase& context) {
  const auto& metadata = context.client_metadata();
  const auto named = metadata.find("teletact-client");
  const std::string_view name = named == metadata.end()
                                    ? std::string_view()
                                    : std::string_view(named->second.data(), named->second.size());
  return client_name(name, context.peer());
}

}  // namespace teletact::service
