#include "service/rpc/call_metadata.h"

#include <fmt/format.h>

#include <iterator>
#include <stdexcept>

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

void require_named(const grpc::ServerContextBase& context, const std::string& scene_id) {
  const auto [first, last] = context.client_metadata().equal_range("teletact-scene");
  for (auto named = first; named != last; ++named) {
    const std::string_view name(named->second.data(), named->second.size());
    if (name != scene_id)
      throw std::invalid_argument(fmt::format(
          "scene_id: the message says \"{}\", the metadata teletact-scene \"{}\"; a proxy may "
          "have brought the call to another node than the scene's: give the same in both, or no metadata",
          shown(scene_id), shown(name)));
  }
}

std::optional<std::string_view> traceparent_in(const grpc::ServerContextBase& context) {
  const auto [begin, end] = context.client_metadata().equal_range("traceparent");
  if (begin == end || std::next(begin) != end) return std::nullopt;
  return std::string_view(begin->second.data(), begin->second.size());
}

void require_short_headers(const grpc::ServerContextBase& context) {
  constexpr std::size_t kBeside = 32;  // as HTTP/2 counts them
  std::size_t bytes = 0;
  for (const auto& [name, value] : context.client_metadata()) bytes += name.size() + value.size() + kBeside;
  if (bytes > kMaxHeaderBytes)
    throw Error(ErrorKind::kExhausted,
                fmt::format("metadata: {} bytes, at most {} are allowed; send fewer or shorter headers",
                            bytes, kMaxHeaderBytes));
}

}  // namespace teletact::service
