// However the client ends, no hand is left with a force: the template adapter's box, which outlives it, is
// asked what its motors give.
#include <gtest/gtest.h>
#include <sys/mman.h>
#include <termios.h>

#include <array>
#include <cmath>
#include <cstdint>
#include <memory>

#include "client/servo/servo_thread.h"
#include "tests/integration/process.h"
#include "tests/link/fake_palpation.h"

namespace teletact {
namespace {

// As client/haptic/plugins/template.c shares it.
struct Page {
  double motor_n[3];
  std::int64_t lapses, let_go, closed;
};

class Box {
 public:
  explicit Box(const test::TemporaryFolder& folder) : file_(folder / "page") {
    std::ofstream(file_) << std::string(4096, '\0');
    const int descriptor = open(file_.c_str(), O_RDONLY | O_CLOEXEC);
    page_ = static_cast<const volatile Page*>(mmap(nullptr, 4096, PROT_READ, MAP_SHARED, descriptor, 0));
    ::close(descriptor);
  }
  ~Box() { munmap(const_cast<Page*>(page_), 4096); }
  // A hand presses by itself.
  std::string device() const {
    return "plugin:" + test::required_environment("TELETACT_BINARY_DIR") +
           "/client/teletact_device_template.so,press=0.009,period=1,page=" + file_;
  }
  const volatile Page& page() const { return *page_; }
  double force_n() const { return std::hypot(page_->motor_n[0], page_->motor_n[1]); }
  template <typename Met>
  static bool within(double seconds, Met&& met) {
    const auto end = std::chrono::steady_clock::now() + std::chrono::duration<double>(seconds);
    while (!met()) {
      if (std::chrono::steady_clock::now() > end) return false;
      std::this_thread::sleep_for(std::chrono::microseconds(300));
    }
    return true;
  }
  bool pushes(double seconds) const {
    return within(seconds, [this] { return force_n() > 0.2; });
  }
  bool has_let_go() const {
    return within(2, [this] { return force_n() == 0; });
  }

 private:
  std::string file_;
  const volatile Page* page_;
};

// An experiment whose person says nothing and presses.
class Ending : public ::testing::Test {
 protected:
  std::vector<std::string> command() const {
    return {test::client_binary(), "experiment", "--person",  "--device", box.device(),
            "--background-n-m",    "300",        "--stimuli", "310",      "320"};
  }
  // After a fault, which a busy machine may be good for (the box gets no turn for 0.1 s), force comes only
  // for an Enter.
  bool pushed() {
    constexpr int kTries = 30;
    for (int n = 0; n < kTries; ++n) {
      if (box.pushes(n == 0 ? 6 : 2)) return true;
      if (write(typed.write_end(), "\n", 1) != 1) return false;
    }
    return false;
  }
  test::TemporaryFolder folder;
  Box box{folder};
  test::Pipe typed;
};

class EndingInOrder : public Ending, public ::testing::WithParamInterface<int> {};
class EndingAtOnce : public Ending, public ::testing::WithParamInterface<int> {};

TEST_P(EndingInOrder, TheDeviceIsClosedWithoutForce) {
  test::Process process(command(), folder / "log", {}, {typed.read_end()});
  ASSERT_TRUE(pushed()) << process.output();
  process.kill(GetParam());
  EXPECT_EQ(process.wait(30), 1) << process.output();  // nothing was answered
  EXPECT_EQ(box.force_n(), 0);
  EXPECT_EQ(box.page().closed, 1);
  EXPECT_EQ(box.page().let_go, 0) << "there was time for the slew limit";
  EXPECT_NE(process.output().find("no trial was answered"), std::string::npos) << process.output();
}
INSTANTIATE_TEST_SUITE_P(Signals, EndingInOrder, ::testing::Values(SIGINT, SIGTERM, SIGHUP));

TEST_P(EndingAtOnce, ZeroIsWrittenFirst) {
  test::Process process(command(), folder / "log", {}, {typed.read_end()});
  ASSERT_TRUE(pushed()) << process.output();
  process.kill(GetParam());
  EXPECT_GT(process.wait(60), 0) << process.output();  // 128 + signal, or a sanitizer's own
  EXPECT_GE(box.page().let_go, 1);
  EXPECT_TRUE(box.has_let_go());
}
INSTANTIATE_TEST_SUITE_P(Signals, EndingAtOnce, ::testing::Values(SIGSEGV, SIGABRT, SIGQUIT, SIGUSR1));

TEST_F(Ending, KilledTheClientCannotActAndTheBoxLetsGo) {
  test::Process process(command(), folder / "log", {}, {typed.read_end()});
  ASSERT_TRUE(pushed()) << process.output();
  process.kill(SIGKILL);
  EXPECT_EQ(process.wait(30), 128 + SIGKILL);
  EXPECT_TRUE(box.has_let_go());
  EXPECT_EQ(box.page().let_go + box.page().closed, 0);
}

TEST_F(Ending, StoppedTheClientDoesNotActAndTheBoxLetsGo) {
  test::Process process(command(), folder / "log", {}, {typed.read_end()});
  ASSERT_TRUE(pushed()) << process.output();
  const std::int64_t lapses = box.page().lapses;
  process.kill(SIGTSTP);  // Ctrl-Z is not taken
  process.kill(SIGSTOP);
  EXPECT_TRUE(Box::within(5, [&] { return box.page().lapses > lapses && box.force_n() == 0; }));
  process.kill(SIGCONT);
  EXPECT_TRUE(pushed()) << process.output();
  process.kill(SIGTERM);
  EXPECT_EQ(process.wait(30), 1) << process.output();
}

TEST_F(Ending, AStdoutThatNobodyReadsEndsNothing) {
  test::Pipe shown;
  test::Process process(command(), folder / "log", {}, {typed.read_end(), shown.write_end()});
  ASSERT_TRUE(pushed()) << process.output();
  shown.close_end(0);
  shown.close_end(1);
  for (int line = 0; line < 3; ++line) ASSERT_EQ(write(typed.write_end(), "\n", 1), 1);
  const auto unread = [this] {
    int bytes = 0;
    ioctl(typed.read_end(), FIONREAD, &bytes);
    return bytes;
  };
  EXPECT_TRUE(Box::within(30, [&] { return unread() == 0; })) << process.output();
  EXPECT_EQ(process.wait(0.2), -1) << process.output();
  EXPECT_TRUE(pushed()) << process.output();
  typed.close_end(1);  // the person has left
  EXPECT_EQ(process.wait(30), 1) << process.output();
  EXPECT_EQ(box.page().closed, 1);
  EXPECT_EQ(box.force_n(), 0);
}

// The service is this process's; the session's end is reported as any.
TEST_F(Ending, AClosedTerminalEndsATouchInOrder) {
  client::test::FakePalpation service("unix:" + (folder / "s"));
  service.serve();
  test::Process process({test::client_binary(), "touch", "--service", "unix:" + (folder / "s"), "--scene",
                         "s", "--device", box.device()},
                        folder / "log", {}, {typed.read_end()});
  ASSERT_TRUE(pushed()) << process.output();
  process.kill(SIGHUP);
  EXPECT_EQ(process.wait(30), 0) << process.output();
  EXPECT_NE(process.output().find("touched scene s"), std::string::npos) << process.output();
  EXPECT_EQ(box.page().closed, 1);
  EXPECT_EQ(box.force_n(), 0);
}

// GIVEN an adapter that does not return from its first read, or from a later one WHEN nobody does anything,
// or asks for an end once THEN the process lets go, says why and ends.
TEST_F(Ending, AnAdapterThatDoesNotReturnKeepsNobody) {
  client::test::FakePalpation service("unix:" + (folder / "s"));
  service.serve();
  const std::string adapter =
      "plugin:" + test::required_environment("TELETACT_BINARY_DIR") + "/tests/plugin_blocks.so,";
  const auto touch = [&](const std::string& read) -> std::vector<std::string> {
    return {test::client_binary(), "touch", "--service", "unix:" + (folder / "s"), "--scene", "s", "--device",
            adapter + read};
  };
  std::vector<std::string> experiment = command();
  experiment[4] = adapter + "300";
  struct Blocked {
    std::unique_ptr<test::Process> process;
    bool interrupted;
  };
  std::vector<Blocked> all;  // at once: each is waited for a second before it is let go
  const auto begin = [&](const std::vector<std::string>& blocked, bool interrupted) {
    const std::string log = folder / ("log" + std::to_string(all.size()));
    all.push_back(
        {std::make_unique<test::Process>(blocked, log, test::Environment{}, test::Streams{typed.read_end()}),
         interrupted});
  };
  for (const char* read : {"1", "300"})
    for (const bool interrupted : {false, true}) begin(touch(read), interrupted);
  begin(experiment, true);
  for (const auto& [process, interrupted] : all) {
    ASSERT_TRUE(process->says("blocked\n", 60)) << process->output();
    if (interrupted) process->kill(SIGINT);
  }
  for (const auto& [process, interrupted] : all) {
    EXPECT_EQ(process->wait(30), client::ServoThread::kStuckCode) << process->output();
    for (const char* said : {"the device's adapter did not return from a call", "let go\n"})
      EXPECT_NE(process->output().find(said), std::string::npos) << process->output();
  }
}

// A terminal of its own for a process.
class Terminal {
 public:
  Terminal() : ours_(posix_openpt(O_RDWR | O_NOCTTY | O_CLOEXEC)) {
    if (ours_ < 0 || grantpt(ours_) != 0 || unlockpt(ours_) != 0) throw std::runtime_error("no terminal");
    theirs_ = open(ptsname(ours_), O_RDWR | O_NOCTTY | O_CLOEXEC);
  }
  ~Terminal() {
    ::close(ours_);
    ::close(theirs_);
  }
  int theirs() const { return theirs_; }
  void press(char key) const { ASSERT_EQ(write(ours_, &key, 1), 1); }
  bool waits_for_lines() const {
    termios now{};
    tcgetattr(theirs_, &now);
    return (now.c_lflag & ICANON) != 0 && (now.c_lflag & ECHO) != 0;
  }

 private:
  int ours_, theirs_ = -1;
};

// GIVEN a device without a button
TEST_F(Ending, KeysResumeAndPauseAndTheTerminalIsGivenBack) {
  client::test::FakePalpation service("unix:" + (folder / "s"));
  service.serve();
  const std::string device =
      "plugin:" + test::required_environment("TELETACT_BINARY_DIR") + "/client/teletact_device_template.so";
  struct Touching {
    int signal;
    Terminal terminal;
    std::unique_ptr<test::Process> process;
  };
  std::array<Touching, 2> both{{{SIGTERM, {}, {}}, {SIGSEGV, {}, {}}}};  // at once: what helps is said late
  for (auto& [signal, terminal, process] : both) {
    ASSERT_TRUE(terminal.waits_for_lines());
    process = std::make_unique<test::Process>(
        std::vector<std::string>{test::client_binary(), "touch", "--service", "unix:" + (folder / "s"),
                                 "--scene", "s", "--device", device},
        folder / ("log" + std::to_string(signal)), test::Environment{}, test::Streams{terminal.theirs()});
  }
  for (auto& [signal, terminal, running] : both) {
    test::Process& process = *running;
    ASSERT_TRUE(process.says("button, or Enter here", 60)) << process.output();
    EXPECT_FALSE(terminal.waits_for_lines());
    bool paused = false;
    for (int n = 0; n < 30 && !paused; ++n) {  // again where a busy machine was silent just then
      terminal.press('\n');
      if (!process.says("servo ENABLED", 2)) continue;
      terminal.press(' ');
      paused = process.says("servo PAUSED: paused by the operator", 2);
    }
    EXPECT_TRUE(paused) << process.output();
    terminal.press('h');
    EXPECT_TRUE(process.says("--hand-over-to", 30)) << process.output();
    process.kill(signal);
    const int code = process.wait(60);
    EXPECT_TRUE(signal == SIGTERM ? code == 0 : code > 0) << code << process.output();
    EXPECT_TRUE(terminal.waits_for_lines());
  }
}

}  // namespace
}  // namespace teletact
