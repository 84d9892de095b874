// A peer of an HTTP server that sends what it likes.
#pragma once

#include <arpa/inet.h>
#include <netinet/in.h>
#include <poll.h>
#include <sys/socket.h>
#include <sys/un.h>
#include <unistd.h>

#include <cerrno>
#include <cstring>
#include <stdexcept>
#include <string>
#include <utility>

namespace teletact::test {

class HttpPeer {
 public:
  // `from`: this peer's own address, of any port.
  explicit HttpPeer(unsigned port, const char* host = "127.0.0.1", const char* from = "127.0.0.1")
      : socket_(::socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0)) {
    const sockaddr_in own = of(from, 0);
    if (::bind(socket_, reinterpret_cast<const sockaddr*>(&own), sizeof own) != 0)
      throw std::runtime_error("cannot have this address");
    connect(of(host, port));
  }
  explicit HttpPeer(const std::string& path) : socket_(::socket(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC, 0)) {
    sockaddr_un to{};
    to.sun_family = AF_UNIX;
    std::strncpy(to.sun_path, path.c_str(), sizeof to.sun_path - 1);
    connect(to);
  }
  HttpPeer(HttpPeer&& other) noexcept : socket_(std::exchange(other.socket_, -1)) {}
  ~HttpPeer() {
    if (socket_ >= 0) ::close(socket_);
  }

  // Whether the other side took it does not matter.
  void send(const std::string& bytes) { ::send(socket_, bytes.data(), bytes.size(), MSG_NOSIGNAL); }
  // Whether the other side has closed. What it has sent is still there.
  bool closed() const {
    char byte = 0;
    const ssize_t n = ::recv(socket_, &byte, 1, MSG_PEEK | MSG_DONTWAIT);
    return n == 0 || (n < 0 && errno == ECONNRESET);
  }
  // Whether something has come, or comes within this time.
  bool answered_within(int milliseconds) const {
    pollfd waiting{socket_, POLLIN, 0};
    return ::poll(&waiting, 1, milliseconds) > 0;
  }
  void close_sending() { ::shutdown(socket_, SHUT_WR); }
  // All that comes until the other side closes, or goes away.
  std::string rest() {
    std::string text;
    char buffer[65536];
    for (ssize_t n = 0; (n = ::recv(socket_, buffer, sizeof buffer, 0)) > 0;)
      text.append(buffer, static_cast<std::size_t>(n));
    return text;
  }

 private:
  static sockaddr_in of(const char* host, unsigned port) {
    sockaddr_in address{};
    address.sin_family = AF_INET;
    address.sin_port = htons(static_cast<std::uint16_t>(port));
    address.sin_addr.s_addr = inet_addr(host);
    return address;
  }
  template <class Address>
  void connect(const Address& to) {
    if (::connect(socket_, reinterpret_cast<const sockaddr*>(&to), sizeof to) != 0)
      throw std::runtime_error("nobody listens");
  }
  int socket_;
};

// Of HOST:PORT.
inline unsigned port_of(const std::string& address) {
  return static_cast<unsigned>(std::stoul(address.substr(address.rfind(':') + 1)));
}

// The whole response.
inline std::string http_get(unsigned port, const std::string& target) {
  HttpPeer peer(port);
  peer.send("GET " + target + " HTTP/1.1\r\nHost: localhost\r\n\r\n");
  return peer.rest();
}

}  // namespace teletact::test
