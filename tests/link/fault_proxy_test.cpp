// The fault proxy does what it says, on an echo service: the other tests lean on it.
#include "tests/support/fault_proxy.h"

#include <gtest/gtest.h>
#include <chrono>
#include <optional>
#include <thread>
#include <vector>

#include "tests/link/echo.h"

namespace teletact::test {
namespace {

Faults both(const DirectionFaults& faults) {
  return {faults, faults};
}

TEST(FaultProxy, PassesBytesOnUnharmed) {
  Echo echo;
  FaultProxy proxy(echo.address);
  Peer peer(proxy.address());
  std::string text;
  for (int k = 0; k < 100'000; ++k) text += static_cast<char>('a' + k % 23);
  peer.say(text);
  EXPECT_EQ(peer.hear(text.size(), 5), text);
  EXPECT_EQ(proxy.bytes_up(), text.size());
  EXPECT_EQ(proxy.bytes_down(), text.size());
}

TEST(FaultProxy, DelaysEachWayAndKeepsTheOrderUnderJitterAndLoss) {
  Echo echo;
  FaultProxy proxy(echo.address, 7);
  proxy.play({.faults = both({.delay_s = 0.05})});
  Peer peer(proxy.address());
  double begin_s = now_s();
  peer.say("x");
  EXPECT_EQ(peer.hear(1, 2), "x");
  EXPECT_GE(now_s() - begin_s, 0.1);
  proxy.play({.faults = both({.jitter_s = 0.03, .loss_share = 0.2, .retransmission_s = 0.05})});
  std::string sent;
  begin_s = now_s();
  for (int k = 0; k < 50; ++k) {
    const std::string text = std::to_string(k) + ",";
    sent += text;
    peer.say(text);
    std::this_thread::sleep_for(std::chrono::milliseconds(2));
  }
  EXPECT_EQ(peer.hear(sent.size(), 2), sent);
  EXPECT_GE(now_s() - begin_s, 0.1 + 0.05);  // some were lost
}

TEST(FaultProxy, AStallHoldsEverythingThenLetsItPass) {
  Echo echo;
  FaultProxy proxy(echo.address);
  Peer peer(proxy.address());
  peer.say("a");
  EXPECT_EQ(peer.hear(1, 2), "a");
  const double begin_s = now_s();
  proxy.play({{.at_s = 0.05, .kind = FaultEvent::Kind::kStall, .seconds = 0.2}});
  std::this_thread::sleep_for(std::chrono::milliseconds(80));
  peer.say("bc");
  EXPECT_EQ(peer.hear(2, 2), "bc");
  EXPECT_GE(now_s() - begin_s, 0.25);
}

TEST(FaultProxy, ANewStreamOvertakesAHeldOne) {
  Echo echo;
  FaultProxy proxy(echo.address);
  Peer old(proxy.address());
  old.say("a");
  EXPECT_EQ(old.hear(1, 2), "a");
  proxy.play({.kind = FaultEvent::Kind::kHold, .seconds = 0.3});
  old.say("late");
  Peer fresh(proxy.address());
  fresh.say("early");
  EXPECT_EQ(fresh.hear(5, 0.2), "early");
  EXPECT_EQ(old.hear(4, 2), "late");
}

TEST(FaultProxy, HalfOpenSaysNothingAndResetCuts) {
  Echo echo;
  FaultProxy proxy(echo.address);
  Peer silent(proxy.address());
  silent.say("a");
  EXPECT_EQ(silent.hear(1, 2), "a");
  proxy.play({.kind = FaultEvent::Kind::kHalfOpen});
  silent.say("b");
  EXPECT_EQ(silent.hear(1, 0.1), "");
  Peer cut(proxy.address());
  cut.say("c");
  EXPECT_EQ(cut.hear(1, 2), "c");
  proxy.play({.kind = FaultEvent::Kind::kReset});
  EXPECT_EQ(cut.hear(1, 2), std::nullopt);
  Peer again(proxy.address());
  again.say("d");
  EXPECT_EQ(again.hear(1, 2), "d");
  EXPECT_EQ(proxy.connections(), 3u);
}

TEST(FaultProxy, DropsWhatIsIdle) {
  Echo echo;
  FaultProxy proxy(echo.address);
  proxy.play({.faults = {.idle_s = 0.2}});
  Peer busy(proxy.address());
  Peer idle(proxy.address());
  const double begin_s = now_s();
  for (int k = 0; k < 9; ++k) {
    busy.say("a");
    EXPECT_EQ(busy.hear(1, 2), "a");
    std::this_thread::sleep_for(std::chrono::milliseconds(30));
  }
  EXPECT_EQ(idle.hear(1, 2), std::nullopt);
  EXPECT_GE(now_s() - begin_s, 0.2);
  EXPECT_EQ(busy.hear(1, 2), std::nullopt);  // now it is idle too
}

TEST(FaultProxy, LimitsBandwidth) {
  Echo echo;
  FaultProxy proxy(echo.address);
  proxy.play({.faults = {{.bandwidth_bytes_s = 200e3}, {}}});
  Peer peer(proxy.address());
  const double begin_s = now_s();
  const std::string text(60'000, 'x');
  peer.say(text);
  EXPECT_EQ(peer.hear(text.size(), 5), text);
  EXPECT_GE(now_s() - begin_s, 0.29);
  EXPECT_LE(now_s() - begin_s, 1.5);
}

TEST(FaultProxy, ADelayIsThatOfEveryByteAndLowersNoThroughput) {
  // GIVEN 0.1 s each way, THEN what fills the way many times over takes little longer than one byte.
  Echo echo;
  FaultProxy proxy(echo.address);
  proxy.play({.faults = both({.delay_s = 0.1})});
  Peer peer(proxy.address());
  std::string text(8 * FaultProxy::kMaxQueuedBytes, ' ');
  for (std::size_t k = 0; k < text.size(); ++k) text[k] = static_cast<char>('a' + k % 23);
  const double begin_s = now_s();
  std::thread saying([&] { peer.say(text); });
  EXPECT_EQ(peer.hear(text.size(), 5), text);
  saying.join();
  EXPECT_GE(now_s() - begin_s, 0.2);
  EXPECT_LE(now_s() - begin_s, 0.8) << "at least 0.9 s where a way holds kMaxQueuedBytes";
}

TEST(FaultProxy, NarrowLinkAddsDelayAndKeepsMessagesApart) {
  Echo echo;
  FaultProxy proxy(echo.address);
  proxy.play({.faults = {{.delay_s = 0.1, .bandwidth_bytes_s = 8e3}, {.delay_s = 0.05}}});
  Peer peer(proxy.address());
  const std::string text(400, 'x');  // 0.05 s on the wire
  double before_s = now_s();
  peer.say(text);
  EXPECT_EQ(peer.hear(text.size(), 2), text);
  EXPECT_GE(now_s() - before_s, 0.2);
  EXPECT_LE(now_s() - before_s, 0.4);
  // Two more in one breath come one sending after the other, however they were read.
  peer.say(text + text);
  before_s = now_s();
  EXPECT_EQ(peer.hear(2 * text.size(), 2), text + text);
  EXPECT_GE(now_s() - before_s, 0.25 - 0.01);
  // A long message is on its way while its end is still being sent.
  before_s = now_s();
  const std::string longer(4000, 'y');  // 0.5 s
  peer.say(longer);
  EXPECT_EQ(peer.hear(100, 2)->substr(0, 100), std::string(100, 'y'));
  EXPECT_LE(now_s() - before_s, 0.5);
}

TEST(FaultProxy, AServiceThatIsNotThereIsAReset) {
  FaultProxy proxy("unix:/nonexistent/socket");
  Peer peer(proxy.address());
  EXPECT_EQ(peer.hear(1, 2), std::nullopt);
}

}  // namespace
}  // namespace teletact::test
