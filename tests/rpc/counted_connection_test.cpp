// What one connection may cost, and when this machine is late with it.
#include <gtest/gtest.h>
#include <sys/socket.h>

#include <chrono>
#include <memory>

#include "service/rpc/connections.h"

namespace teletact::service {
namespace {

// Both ends of a connection, the service's counted.
struct Pair {
  Pair() {
    int ends[2];
    EXPECT_EQ(::socketpair(AF_UNIX, SOCK_STREAM, 0, ends), 0);
    theirs = FileDescriptor(ends[1]), same = FileDescriptor(::dup(ends[0]));
    ours = std::make_unique<CountedConnection>(FileDescriptor(ends[0]), "peer", "host");
  }
  bool cut() const {
    char byte = 0;
    return ::recv(theirs.get(), &byte, 1, MSG_DONTWAIT) == 0;
  }
  FileDescriptor theirs, same;  // the latter: ours, as gRPC has it
  std::unique_ptr<CountedConnection> ours;
};

TEST(CountedConnection, CallsThatPileUpCutIt) {
  const int kMaxOpen = ConnectionLimits{}.max_open;
  const Pair pair;
  for (int k = 0; k < 10 * kMaxOpen; ++k) pair.ours->begun(), pair.ours->ended();
  for (int k = 0; k < kMaxOpen; ++k) pair.ours->begun();
  EXPECT_FALSE(pair.cut());
  pair.ours->begun();
  EXPECT_TRUE(pair.cut());
}

TEST(CountedConnection, TakesLittleUntilItIsKnown) {
  const auto window = [](const FileDescriptor& socket) {
    int bytes = 0;
    socklen_t size = sizeof bytes;
    EXPECT_EQ(::getsockopt(socket.get(), SOL_SOCKET, SO_RCVBUF, &bytes, &size), 0);
    return bytes;
  };
  const Pair pair;
  EXPECT_LE(window(pair.same), 2 * ConnectionLimits{}.unknown_window_bytes);
  pair.ours->vouch();
  EXPECT_EQ(window(pair.same), window(pair.theirs)) << "as the kernel sizes them";
}

// What lies there at two looks: what it owes may be among it.
TEST(CountedConnection, IsLateWhileNobodyReads) {
  using Clock = CountedConnection::Clock;
  const Pair pair;
  auto now = Clock::now();
  const auto late = [&] {
    pair.ours->look(now += std::chrono::milliseconds(20));
    return pair.ours->late_at() == now;
  };
  EXPECT_FALSE(late() || late());
  ASSERT_EQ(::send(pair.theirs.get(), "ab", 2, 0), 2);
  EXPECT_FALSE(late());
  EXPECT_TRUE(late());
  char byte = 0;
  ASSERT_EQ(::recv(pair.same.get(), &byte, 1, 0), 1);  // some of it: it goes on
  EXPECT_FALSE(late());
}

TEST(CountedConnection, CallsThatComeToNothingCutIt) {
  const Pair pair;
  for (int k = 0; k < 500; ++k) pair.ours->wasted();
  EXPECT_FALSE(pair.cut());
  for (int k = 0; k < 1'000'000 && !pair.ours->was_cut(); ++k) pair.ours->wasted();
  EXPECT_TRUE(pair.cut());
}

}  // namespace
}  // namespace teletact::service
