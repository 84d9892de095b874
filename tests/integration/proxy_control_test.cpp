// teletact-proxy as a process: what the words of its --control do to the link.
#include <sys/stat.h>

#include "tests/integration/process.h"
#include "tests/link/echo.h"

namespace teletact::test {
namespace {

std::string proxy_binary() {
  return required_environment("TELETACT_BINARY_DIR") + "/bench/teletact-proxy";
}

class ProxyControl : public ::testing::Test {
 protected:
  ProxyControl() {
    EXPECT_EQ(::mkfifo((folder_ / "link").c_str(), 0600), 0);
    pipe_ = ::open((folder_ / "link").c_str(), O_RDWR | O_CLOEXEC);
    proxy_.emplace(
        std::vector<std::string>{proxy_binary(), "--service", echo_.address, "--control", folder_ / "link"},
        folder_ / "log");
    const std::string begin = "passing on at ";
    EXPECT_TRUE(proxy_->says(begin, 30)) << proxy_->output();
    EXPECT_TRUE(proxy_->says("\n", 30));
    const std::string said = proxy_->output();
    address = said.substr(said.find(begin) + begin.size());
  }
  ~ProxyControl() override {
    proxy_->kill(SIGTERM);
    EXPECT_EQ(proxy_->wait(30), 0) << proxy_->output();
    ::close(pipe_);
  }
  void say(const std::string& words) const {
    ASSERT_EQ(::write(pipe_, words.data(), words.size()), static_cast<ssize_t>(words.size()));
  }
  // How long a byte takes there and back; none: the connection was cut.
  static std::optional<double> round_trip_s(Peer& peer) {
    const double begin_s = now_s();
    peer.say("x");
    if (peer.hear(1, 30) != "x") return std::nullopt;
    return now_s() - begin_s;
  }
  // Within half a minute a byte takes at least, or at most, so long.
  template <class Is>
  static bool comes_to(Peer& peer, Is&& is) {
    for (const double end_s = now_s() + 30; now_s() < end_s;) {
      const auto took_s = round_trip_s(peer);
      if (!took_s) return false;
      if (is(*took_s)) return true;
      std::this_thread::sleep_for(std::chrono::milliseconds(10));
    }
    return false;
  }

  std::string address;

 private:
  Echo echo_;
  const TemporaryFolder folder_;
  int pipe_ = -1;
  std::optional<Process> proxy_;
};

TEST_F(ProxyControl, FarAndJitterLastUntilTheLinkIsGoodAgain) {
  Peer peer(address);
  EXPECT_TRUE(round_trip_s(peer));
  say("far\n");
  EXPECT_TRUE(comes_to(peer, [](double took_s) { return took_s >= 0.2; }));
  for (int n = 0; n < 3; ++n) EXPECT_GE(round_trip_s(peer).value_or(0), 0.2);
  say("jitter\n");
  EXPECT_TRUE(comes_to(peer, [](double took_s) { return took_s < 0.2; }));
  for (int n = 0; n < 10; ++n) EXPECT_GE(round_trip_s(peer).value_or(0), 0.01);
  say("no such word\nno");
  say("ne\n");
  EXPECT_TRUE(comes_to(peer, [](double took_s) { return took_s < 0.01; }));
}

TEST_F(ProxyControl, AStallEndsAndACutTakesTheConnection) {
  Peer peer(address);
  EXPECT_TRUE(round_trip_s(peer));
  say("stall\n");
  EXPECT_TRUE(comes_to(peer, [](double took_s) { return took_s >= 0.5; }));
  EXPECT_TRUE(comes_to(peer, [](double took_s) { return took_s < 0.2; }));
  say("cut\n");
  EXPECT_EQ(peer.hear(1, 30), std::nullopt) << "not reset";
  Peer fresh(address);
  EXPECT_GE(round_trip_s(fresh).value_or(0), 0.5) << "nothing passes for two seconds";
  EXPECT_TRUE(comes_to(fresh, [](double took_s) { return took_s < 0.2; }));
}

TEST(Proxy, APipeThatIsNotThereIsRefused) {
  const TemporaryFolder folder;
  const Outcome outcome =
      run({proxy_binary(), "--service", "127.0.0.1:1", "--control", "/no/such/pipe"}, folder / "log");
  EXPECT_EQ(outcome.code, 1);
  EXPECT_EQ(outcome.output, "--control /no/such/pipe: cannot be read; make it by mkfifo\n");
}

}  // namespace
}  // namespace teletact::test
