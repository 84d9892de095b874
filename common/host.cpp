#include "common/host.h"

#include <iterator>
#include <string_view>

namespace teletact {

namespace {

bool is_loopback(std::string_view host) {
  const std::size_t colon = host.rfind(':');
  if (colon != std::string_view::npos && host.find(']', colon) == std::string_view::npos)
    host = host.substr(0, colon);
  return host == "127.0.0.1" || host == "localhost" || host == "[::1]";
}

}  // namespace

std::optional<HostRefusal> host_refusal(const boost::beast::http::request_header<>& request) {
  constexpr unsigned kVersion11 = 11;
  const auto [first, last] = request.equal_range(boost::beast::http::field::host);
  if (first == last) {
    if (request.version() < kVersion11) return std::nullopt;
    return HostRefusal{400, "Host: missing; HTTP/1.1 asks for it\n"};
  }
  if (std::next(first) != last) return HostRefusal{400, "Host: give it once\n"};
  const auto host = first->value();
  if (is_loopback({host.data(), host.size()})) return std::nullopt;
  return HostRefusal{403, "Host: this machine's loopback alone\n"};
}

}  // namespace teletact
