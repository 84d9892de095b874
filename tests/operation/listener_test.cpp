// What accepts connections, when the process is short of something.
#include "common/listener.h"

#include <gtest/gtest.h>
#include <sys/resource.h>
#include <sys/time.h>

#include <boost/asio/buffer.hpp>
#include <boost/asio/ip/tcp.hpp>
#include <boost/asio/post.hpp>
#include <boost/asio/write.hpp>
#include <chrono>
#include <cstdint>
#include <exception>
#include <functional>
#include <future>
#include <memory>
#include <new>
#include <string>
#include <utility>

#include "tests/operation/http_peer.h"

namespace teletact::service {
namespace {

namespace asio = boost::asio;

void say_yes(Listener::Protocol::socket socket, const Listener::Place&) {
  asio::write(socket, asio::buffer("yes", 3));
}

Listener::Options on_port(unsigned port,
                          std::function<void(Listener::Protocol::socket, Listener::Place)> take) {
  Listener::Options options;
  options.endpoint =
      asio::ip::tcp::endpoint(asio::ip::make_address("127.0.0.1"), static_cast<std::uint16_t>(port));
  options.take = std::move(take);
  return options;
}

// A socket that connects later, and gives up reading in time.
class LatePeer {
 public:
  LatePeer() : socket_(::socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0)) {
    const timeval patience{5, 0};
    ::setsockopt(socket_, SOL_SOCKET, SO_RCVTIMEO, &patience, sizeof patience);
  }
  ~LatePeer() { ::close(socket_); }
  LatePeer(const LatePeer&) = delete;
  LatePeer& operator=(const LatePeer&) = delete;

  bool connect(unsigned port) {
    sockaddr_in to{};
    to.sin_family = AF_INET;
    to.sin_port = htons(static_cast<std::uint16_t>(port));
    to.sin_addr.s_addr = inet_addr("127.0.0.1");
    return ::connect(socket_, reinterpret_cast<const sockaddr*>(&to), sizeof to) == 0;
  }
  std::string answer() {
    char buffer[8];
    const ssize_t n = ::recv(socket_, buffer, sizeof buffer, 0);
    return n < 0 ? "none came" : std::string(buffer, static_cast<std::size_t>(n));
  }
  // As many as there may be: this process gets no further one.
  rlimit take_the_last() const {
    rlimit before{};
    getrlimit(RLIMIT_NOFILE, &before);
    const int next = ::dup(socket_);
    ::close(next);
    const rlimit none_left{static_cast<rlim_t>(next), before.rlim_max};
    setrlimit(RLIMIT_NOFILE, &none_left);
    return before;
  }

 private:
  int socket_;
};

TEST(Listener, AcceptsAgainOnceThereAreDescriptors) {
  Listener listener(on_port(0, say_yes));
  listener.begin();
  LatePeer peer;
  const rlimit before = peer.take_the_last();
  const bool connected = peer.connect(listener.port());
  for (int turn = 0; turn < 20; ++turn) {  // of its thread: by then it has tried to accept
    const auto done = std::make_shared<std::promise<void>>();
    asio::post(listener.io(), [done] { done->set_value(); });
    if (done->get_future().wait_for(std::chrono::seconds(2)) == std::future_status::timeout) break;
  }
  setrlimit(RLIMIT_NOFILE, &before);
  ASSERT_TRUE(connected);
  EXPECT_EQ(peer.answer(), "yes");
}

TEST(Listener, ConnectionWithoutMemoryLeavesOthersServed) {
  int taken = 0, failures = 0;
  Listener::Options options =
      on_port(0, [&](Listener::Protocol::socket socket, const Listener::Place& place) {
        if (++taken == 1) throw std::bad_alloc();
        say_yes(std::move(socket), place);
      });
  options.failed = [&](const std::exception&) { ++failures; };
  Listener listener(std::move(options));
  listener.begin();
  LatePeer first, second;
  ASSERT_TRUE(first.connect(listener.port()));
  EXPECT_EQ(first.answer(), "");
  ASSERT_TRUE(second.connect(listener.port()));
  EXPECT_EQ(second.answer(), "yes");
  listener.end();
  EXPECT_EQ(failures, 1);
}

// Of the former one a closed connection still waits for stray packets.
TEST(Listener, PortIsFreeAtOnceAfterTheEnd) {
  unsigned port = 0;
  {
    Listener listener(on_port(0, say_yes));
    listener.begin();
    port = listener.port();
    LatePeer peer;
    ASSERT_TRUE(peer.connect(port));
    EXPECT_EQ(peer.answer(), "yes");
    EXPECT_EQ(peer.answer(), "");
  }
  EXPECT_NO_THROW(Listener(on_port(port, say_yes)));
}

}  // namespace
}  // namespace teletact::service
