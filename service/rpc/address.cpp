#include "service/rpc/address.h"

#include <arpa/inet.h>
#include <fmt/format.h>
#include <linux/tcp.h>
#include <netdb.h>
#include <sys/socket.h>
#include <sys/un.h>
#include <unistd.h>

#include <cerrno>
#include <charconv>
#include <cstring>
#include <memory>
#include <set>
#include <stdexcept>
#include <utility>

#include "service/base/shown.h"
#include "service/scene/files.h"

namespace teletact::service {

namespace {

constexpr std::size_t kLongestSocketPath = sizeof(sockaddr_un::sun_path) - 1;  // 107

// As the command line has it.
struct Given {
  const char* flag;
  const std::string& address;
};

[[noreturn]] void refuse(const Given& given, const std::string& why) {
  throw std::runtime_error(
      fmt::format("{} {}: {}", given.flag, shown(given.address, 2 * kLongestSocketPath), why));
}

std::shared_ptr<void> prepare_socket(const Given& o, const std::string& path) {
  constexpr const char* kInUse = "address in use: another service answers there";
  if (path.size() > kLongestSocketPath)
    refuse(o, fmt::format("the path has {} bytes, a Unix socket's may have {}; choose a shorter one",
                          path.size(), kLongestSocketPath));
  std::error_code ignored;
  if (!std::filesystem::is_directory(std::filesystem::absolute(path).parent_path(), ignored))
    refuse(o, "the socket's folder does not exist");
  std::shared_ptr<void> held;
  try {
    held = machine_files()->lock(path + ".lock", false);
  } catch (const FileError& error) {
    refuse(o, error.what());
  }
  if (!held) refuse(o, kInUse);
  sockaddr_un address{};
  address.sun_family = AF_UNIX;
  std::memcpy(address.sun_path, path.c_str(), path.size() + 1);
  const FileDescriptor file(::socket(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC, 0));
  if (!file) refuse(o, std::strerror(errno));
  const int rc = ::connect(file.get(), reinterpret_cast<const sockaddr*>(&address), sizeof(address));
  const int error = errno;
  if (rc == 0) refuse(o, kInUse);
  if (error == ECONNREFUSED) {
    if (!std::filesystem::is_socket(path, ignored))
      refuse(o, "exists and is not a socket; choose another path");
    std::filesystem::remove(path, ignored);  // left over by a service that was killed
  } else if (error != ENOENT) {
    refuse(o, std::strerror(error));
  }
  return held;
}

bool loopback(const std::string& host) {
  if (host == "localhost") return true;
  in_addr v4{};
  in6_addr v6{};
  if (inet_pton(AF_INET, host.c_str(), &v4) == 1) return (ntohl(v4.s_addr) >> 24) == 127;
  return inet_pton(AF_INET6, host.c_str(), &v6) == 1 && IN6_IS_ADDR_LOOPBACK(&v6);
}

std::string words_of(int error, std::uint16_t port) {
  constexpr std::uint16_t kFirstForAll = 1024;
  const std::string words = std::strerror(error);
  if (error == EACCES && port < kFirstForAll)
    return words + ": ports below 1024 take root or CAP_NET_BIND_SERVICE; choose another port";
  return words + (error == EADDRNOTAVAIL ? ": it is not this machine's; give one of its own" : "");
}

// Connections inherit the options.
bool listens(int socket, const addrinfo& at) {
  constexpr int kWaiting = 1024;                           // in the system's queue
  constexpr int kYes = 1, kNo = 0, kUnansweredMs = 5'000;  // for what is sent and not received
  // As gRPC sets them. Connections that linger from an earlier service are no hindrance.
  ::setsockopt(socket, SOL_SOCKET, SO_REUSEADDR, &kYes, sizeof kYes);
  ::setsockopt(socket, IPPROTO_TCP, TCP_NODELAY, &kYes, sizeof kYes);
  ::setsockopt(socket, IPPROTO_TCP, TCP_USER_TIMEOUT, &kUnansweredMs, sizeof kUnansweredMs);
  if (at.ai_family == AF_INET6) ::setsockopt(socket, IPPROTO_IPV6, IPV6_V6ONLY, &kNo, sizeof kNo);
  return ::bind(socket, at.ai_addr, at.ai_addrlen) == 0 && ::listen(socket, kWaiting) == 0;
}

// Both families have the port in one place.
std::uint16_t port_of(int socket) {
  sockaddr_storage address{};
  socklen_t size = sizeof address;
  ::getsockname(socket, reinterpret_cast<sockaddr*>(&address), &size);
  return ntohs(reinterpret_cast<const sockaddr_in&>(address).sin_port);
}

// At every address that the host stands for and this machine has. All must be free: with one of them another
// process's, clients would find either. Port 0 becomes one that is free.
std::vector<FileDescriptor> listen_at(const Given& o, const std::string& host, std::uint16_t& port) {
  addrinfo hints{}, *all = nullptr;
  hints.ai_socktype = SOCK_STREAM;
  if (const int failed = ::getaddrinfo(host.c_str(), "0", &hints, &all); failed != 0)
    refuse(o, ::gai_strerror(failed));
  const std::unique_ptr<addrinfo, decltype(&::freeaddrinfo)> found(all, &::freeaddrinfo);
  std::vector<FileDescriptor> sockets;
  std::set<std::string> seen;  // a file of hosts may name one twice
  int error = 0;
  for (const addrinfo* at = found.get(); at != nullptr; at = at->ai_next) {
    if (!seen.emplace(reinterpret_cast<const char*>(at->ai_addr), at->ai_addrlen).second) continue;
    reinterpret_cast<sockaddr_in*>(at->ai_addr)->sin_port = htons(port);
    FileDescriptor socket(::socket(at->ai_family, SOCK_STREAM | SOCK_CLOEXEC | SOCK_NONBLOCK, 0));
    if (socket && listens(socket.get(), *at)) {
      port = port_of(socket.get());
      sockets.push_back(std::move(socket));
    } else if (error = errno; error == EADDRINUSE) {
      refuse(o, "address in use: another process listens there; choose another port");
    }
  }
  if (sockets.empty()) refuse(o, words_of(error, port));
  return sockets;
}

bool encrypted(const ListenOptions& o) {
  return !o.tls_certificate.empty();
}

}  // namespace

Address parse_address(const char* flag, const std::string& text) {
  const Given given{flag, text};
  Address out;
  if (text.starts_with("unix:")) {
    out.socket = text.substr(text.starts_with("unix://") ? 7 : 5);  // unix:///run/x.sock
    if (out.socket.empty()) refuse(given, "give the socket's path, unix:/run/teletact.sock");
    return out;
  }
  const std::size_t colon = text.rfind(':');
  if (colon == std::string::npos) refuse(given, "give HOST:PORT or unix:/path");
  out.host = text.substr(0, colon);
  if (out.host.starts_with('[') && out.host.ends_with(']'))
    out.host = out.host.substr(1, out.host.size() - 2);
  else if (out.host.find(':') != std::string::npos)
    refuse(given, "an IPv6 address stands in brackets: [::1]:50051");
  if (out.host.empty()) refuse(given, "the host is missing; give HOST:PORT or unix:/path");
  const char* const end = text.data() + text.size();
  const auto port = std::from_chars(text.data() + colon + 1, end, out.port);
  if (port.ec != std::errc() || port.ptr != end) refuse(given, "the port must be 0 to 65535");
  return out;
}

Listening prepare_address(const ListenOptions& o) {
  if (o.tls_certificate.empty() != o.tls_key.empty())
    throw std::runtime_error("--tls-certificate and --tls-key: give both or none");
  if (!o.tls_client_ca.empty() && !encrypted(o))
    throw std::runtime_error("--tls-client-ca: needs TLS; also give --tls-certificate and --tls-key");
  const Given given{"--listen", o.listen};
  Address address = parse_address(given.flag, given.address);
  if (!address.socket.empty()) return {"unix:" + address.socket, prepare_socket(given, address.socket), {}};
  if (!loopback(address.host) && !encrypted(o)) {
    if (!o.access.empty())
      refuse(given,
             "with --access tokens would pass other machines in the clear, --allow-insecure-remote or not; "
             "give --tls-certificate and --tls-key");
    if (!o.allow_insecure_remote)
      refuse(given,
             "reachable from other machines without encryption; give --tls-certificate and --tls-key, or "
             "--allow-insecure-remote if the network is trusted");
  }
  auto sockets = listen_at(given, address.host, address.port);
  return {o.listen.substr(0, o.listen.rfind(':') + 1) + std::to_string(address.port), nullptr,
          std::move(sockets)};
}

Address prepare_local_address(const char* flag, const std::string& text) {
  const Given given{flag, text};
  Address address = parse_address(given.flag, given.address);
  if (!address.socket.empty()) {
    address.held = prepare_socket(given, address.socket);
    return address;
  }
  if (!loopback(address.host))
    refuse(given, "reachable from other machines; give 127.0.0.1:PORT or unix:/path");
  if (address.host == "localhost") address.host = "127.0.0.1";
  // Whoever asks listens for itself.
  if (address.port != 0) listen_at(given, address.host, address.port);
  return address;
}

}  // namespace teletact::service
