// A connection to a service that can be cut under its calls, as by a client that dies.
#pragma once

#include <arpa/inet.h>
#include <fcntl.h>
#include <grpcpp/create_channel_posix.h>
#include <netinet/in.h>
#include <netinet/tcp.h>
#include <sys/socket.h>
#include <sys/un.h>
#include <unistd.h>

#include <memory>
#include <string>

namespace teletact::test {

class ResettableConnection {
 public:
  // "127.0.0.1:port" or "unix:/path". Where nobody listens, all calls end UNAVAILABLE.
  explicit ResettableConnection(const std::string& address) {
    const int fd = address.starts_with("unix:") ? connect_unix(address.substr(5)) : connect_tcp(address);
    ::fcntl(fd, F_SETFL, ::fcntl(fd, F_GETFL) | O_NONBLOCK);
    fd_ = ::fcntl(fd, F_DUPFD_CLOEXEC, 0);  // gRPC closes its own
    channel_ = grpc::CreateInsecureChannelFromFd("to-be-reset", fd);
  }
  ~ResettableConnection() { ::close(fd_); }
  ResettableConnection(const ResettableConnection&) = delete;
  ResettableConnection& operator=(const ResettableConnection&) = delete;

  const std::shared_ptr<grpc::Channel>& channel() const { return channel_; }
  // Whatever was on its way is gone; over TCP the peer gets a RST.
  void reset() {
    sockaddr nowhere{};
    nowhere.sa_family = AF_UNSPEC;
    if (::connect(fd_, &nowhere, sizeof nowhere) != 0) ::shutdown(fd_, SHUT_RDWR);
  }

 private:
  static int connect_tcp(const std::string& address) {
    const auto colon = address.rfind(':');
    sockaddr_in to{};
    to.sin_family = AF_INET;
    to.sin_port = htons(static_cast<std::uint16_t>(std::stoi(address.substr(colon + 1))));
    inet_pton(AF_INET, address.substr(0, colon).c_str(), &to.sin_addr);
    const int fd = ::socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0);
    [[maybe_unused]] const int refused = ::connect(fd, reinterpret_cast<sockaddr*>(&to), sizeof to);
    const int at_once = 1;
    ::setsockopt(fd, IPPROTO_TCP, TCP_NODELAY, &at_once, sizeof at_once);
    return fd;
  }
  static int connect_unix(const std::string& path) {
    sockaddr_un to{};
    to.sun_family = AF_UNIX;
    path.copy(to.sun_path, sizeof to.sun_path - 1);
    const int fd = ::socket(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC, 0);
    [[maybe_unused]] const int refused = ::connect(fd, reinterpret_cast<sockaddr*>(&to), sizeof to);
    return fd;
  }
  int fd_ = -1;
  std::shared_ptr<grpc::Channel> channel_;
};

}  // namespace teletact::test
