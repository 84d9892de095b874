// A peer that speaks HTTP/2 as it likes: it writes frames by hand, acknowledges no settings, and takes no
// more than it wants to.
#pragma once

#include <arpa/inet.h>
#include <netinet/in.h>
#include <poll.h>
#include <sys/socket.h>
#include <unistd.h>

#include <cstdint>
#include <stdexcept>
#include <string>
#include <utility>
#include <vector>

namespace teletact::service {

class Http2Peer {
 public:
  enum Type : std::uint8_t {
    kData = 0,
    kHeaders = 1,
    kReset = 3,
    kSettings = 4,
    kPing = 6,
    kContinuation = 9
  };
  enum Flag : std::uint8_t { kNone = 0, kEndStream = 1, kEndHeaders = 4 };
  using Headers = std::vector<std::pair<std::string, std::string>>;

  // `address`: 127.0.0.1:PORT. `settings`: their bytes, six each. `host`: it calls from 127.0.0.HOST.
  explicit Http2Peer(const std::string& address, const std::string& settings = "", std::uint32_t host = 1)
      : socket_(::socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0)) {
    sockaddr_in to{};
    to.sin_family = AF_INET;
    to.sin_addr.s_addr = htonl(INADDR_LOOPBACK - 1 + host);
    ::bind(socket_, reinterpret_cast<const sockaddr*>(&to), sizeof to);
    to.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
    to.sin_port = htons(static_cast<std::uint16_t>(std::stoul(address.substr(address.rfind(':') + 1))));
    if (::connect(socket_, reinterpret_cast<const sockaddr*>(&to), sizeof to) != 0)
      throw std::runtime_error("nobody listens");
    send("PRI * HTTP/2.0\r\n\r\nSM\r\n\r\n" + frame(kSettings, kNone, 0, settings));
  }
  Http2Peer(Http2Peer&& other) noexcept : socket_(std::exchange(other.socket_, -1)) {}
  ~Http2Peer() {
    if (socket_ >= 0) ::close(socket_);
  }

  // False: nobody is there any more.
  bool send(const std::string& bytes) {
    for (std::size_t sent = 0; sent < bytes.size();) {
      const ssize_t n = ::send(socket_, bytes.data() + sent, bytes.size() - sent, MSG_NOSIGNAL);
      if (n <= 0) return false;
      sent += static_cast<std::size_t>(n);
    }
    return true;
  }
  // Takes what is there, or waits for some. False: the other side has closed.
  bool receive(int patience_ms = 0) {
    pollfd there{socket_, POLLIN, 0};
    while (::poll(&there, 1, patience_ms) > 0) {
      char bytes[65536];
      const ssize_t n = ::recv(socket_, bytes, sizeof bytes, 0);
      if (n <= 0) return false;
      received_.append(bytes, static_cast<std::size_t>(n));
      patience_ms = 0;
    }
    return true;
  }
  // All that came, as bytes.
  const std::string& received() const { return received_; }

  static std::string frame(Type type, std::uint8_t flags, std::uint32_t stream, const std::string& payload) {
    return big_endian(payload.size(), 3) + static_cast<char>(type) + static_cast<char>(flags) +
           big_endian(stream, 4) + payload;
  }
  // Literal ones, none indexed.
  static std::string block(const Headers& headers) {
    std::string bytes;
    for (const auto& [name, value] : headers) bytes += '\0' + text(name) + text(value);
    return bytes;
  }
  static std::string call(std::uint32_t stream, const std::string& method, const Headers& more = {}) {
    Headers headers{{":method", "POST"}, {":scheme", "http"}, {":path", method},
                    {":authority", "a"}, {"te", "trailers"},  {"content-type", "application/grpc"}};
    headers.insert(headers.end(), more.begin(), more.end());
    const std::string all = block(headers);
    constexpr std::size_t kMax = 16384;  // of a frame
    std::string bytes =
        frame(kHeaders, all.size() <= kMax ? kEndHeaders : kNone, stream, all.substr(0, kMax));
    for (std::size_t at = kMax; at < all.size(); at += kMax)
      bytes +=
          frame(kContinuation, at + kMax < all.size() ? kNone : kEndHeaders, stream, all.substr(at, kMax));
    return bytes;
  }
  static std::string reset(std::uint32_t stream) { return frame(kReset, kNone, stream, big_endian(8, 4)); }
  // One message in one frame.
  static std::string message(std::uint32_t stream, const std::string& bytes, bool last,
                             bool compressed = false) {
    return frame(kData, last ? kEndStream : kNone, stream,
                 static_cast<char>(compressed) + big_endian(bytes.size(), 4) + bytes);
  }
  static std::string setting(std::uint16_t name, std::uint32_t value) {
    return big_endian(name, 2) + big_endian(value, 4);
  }

 private:
  static std::string big_endian(std::uint64_t value, int bytes) {
    std::string out;
    for (int k = bytes - 1; k >= 0; --k) out += static_cast<char>(value >> (8 * k));
    return out;
  }
  // HPACK's, without Huffman's code: a length of seven bits, then more of seven each.
  static std::string text(const std::string& in) {
    constexpr std::size_t kMax = 127;
    if (in.size() < kMax) return static_cast<char>(in.size()) + in;
    std::string out(1, static_cast<char>(kMax));
    std::size_t rest = in.size() - kMax;
    for (; rest >= 128; rest /= 128) out += static_cast<char>(128 + rest % 128);
    return out + static_cast<char>(rest) + in;
  }
  int socket_;
  std::string received_;
};

}  // namespace teletact::service
