// A service that sends back what it gets, and who speaks to it over a proxy.
#pragma once

#include <gtest/gtest.h>
#include <netinet/in.h>
#include <netinet/tcp.h>
#include <poll.h>
#include <sys/socket.h>
#include <unistd.h>

#include <algorithm>
#include <atomic>
#include <chrono>
#include <optional>
#include <string>
#include <thread>
#include <vector>

#include "tests/support/clock.h"

namespace teletact::test {

// Sends back what it gets, on every connection.
class Echo {
 public:
  Echo() {
    listening_ = socket(AF_INET, SOCK_STREAM, 0);
    sockaddr_in address{};
    address.sin_family = AF_INET;
    address.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
    socklen_t size = sizeof address;
    bind(listening_, reinterpret_cast<sockaddr*>(&address), size);
    listen(listening_, 8);
    getsockname(listening_, reinterpret_cast<sockaddr*>(&address), &size);
    this->address = "127.0.0.1:" + std::to_string(ntohs(address.sin_port));
    thread_ = std::thread([this] { run(); });
  }
  ~Echo() {
    stop_ = true;
    thread_.join();
  }
  std::string address;

 private:
  void run() {
    std::vector<pollfd> polled{{listening_, POLLIN, 0}};
    while (!stop_) {
      poll(polled.data(), polled.size(), 10);
      const std::size_t count = polled.size();
      if (polled[0].revents) polled.push_back({accept(listening_, nullptr, nullptr), POLLIN, 0});
      for (std::size_t k = 1; k < count; ++k) {
        if (!polled[k].revents) continue;
        char buffer[65536];
        const ssize_t got = read(polled[k].fd, buffer, sizeof buffer);
        if (got <= 0 || send(polled[k].fd, buffer, static_cast<std::size_t>(got), MSG_NOSIGNAL) != got) {
          close(polled[k].fd);
          polled[k].fd = -1;
        }
      }
    }
    for (const pollfd& socket : polled) close(socket.fd);
  }
  int listening_ = -1;
  std::atomic<bool> stop_{false};
  std::thread thread_;
};

class Peer {
 public:
  explicit Peer(const std::string& address) {
    socket_ = socket(AF_INET, SOCK_STREAM, 0);
    sockaddr_in to{};
    to.sin_family = AF_INET;
    to.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
    to.sin_port = htons(static_cast<std::uint16_t>(std::stoi(address.substr(address.rfind(':') + 1))));
    if (connect(socket_, reinterpret_cast<sockaddr*>(&to), sizeof to) != 0) ADD_FAILURE() << "connect";
    const int on = 1;
    setsockopt(socket_, IPPROTO_TCP, TCP_NODELAY, &on, sizeof on);
  }
  ~Peer() { close(socket_); }
  void say(const std::string& text) {
    ASSERT_EQ(send(socket_, text.data(), text.size(), 0), ssize_t(text.size()));
  }
  // `bytes` bytes within `seconds`; fewer when they do not come; none when the connection was cut.
  std::optional<std::string> hear(std::size_t bytes, double seconds) {
    const double end_s = now_s() + seconds;
    std::string text;
    while (text.size() < bytes) {
      pollfd polled{socket_, POLLIN, 0};
      if (poll(&polled, 1, std::max(0, int((end_s - now_s()) * 1e3))) == 0) return text;
      char buffer[65536];
      const ssize_t got = recv(socket_, buffer, sizeof buffer, 0);
      if (got <= 0) return std::nullopt;
      text.append(buffer, static_cast<std::size_t>(got));
    }
    return text;
  }

 private:
  int socket_;
};

}  // namespace teletact::test
