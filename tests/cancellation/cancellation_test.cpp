// Every call of the contract, in every state of the service, ended at a random point, with messages of every
// kind: whatever a peer does, the process lives, a client beside it is served, and all is given back.
//
// One service runs throughout (serving, full, scenes deleted under the calls); each round makes another that
// starts and drains. The client and the services share a process, so that the sanitizers see all of it.
//   TELETACT_FUZZ_CALLS  about how many calls (100000; the first tier: 10000, or more, see rounds())
//   TELETACT_FUZZ_SEED   what is sent and when it ends follows from it; how the threads meet does not
#include <fmt/format.h>
#include <malloc.h>

#include <algorithm>
#include <csignal>
#include <cstdio>
#include <cstdlib>
#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "tests/cancellation/fuzz/traffic.h"
#include "tests/cancellation/stage.h"
#include "tests/rpc/estimate_client.h"
#include "tests/support/number_in.h"

#if defined(__SANITIZE_ADDRESS__) || defined(__SANITIZE_THREAD__)
extern "C" std::size_t __sanitizer_get_current_allocated_bytes();  // GCC ships no header for it
#endif

namespace teletact::test {
namespace {

using service::Bystander;

constexpr double kUndisturbedPeriodS = 0.01;
constexpr std::uint64_t kAllCalls = 100'000;

// What is allocated and not free: the same whether or not a sanitizer keeps what was freed.
std::size_t allocated_bytes() {
#if defined(__SANITIZE_ADDRESS__) || defined(__SANITIZE_THREAD__)
  return __sanitizer_get_current_allocated_bytes();
#else
  malloc_trim(0);
  const auto info = mallinfo2();
  return info.uordblks + info.hblkhd;
#endif
}

std::size_t threads() {
  const std::filesystem::directory_iterator tasks("/proc/self/task");
  return static_cast<std::size_t>(std::distance(begin(tasks), end(tasks)));
}

// What the calls leave: the median of what was held over the last third of them against the second third, so
// that neither caches that fill at first nor what happens to be going on, or not to be, counts.
class Growth {
 public:
  void add(std::size_t calls, std::size_t bytes) { samples_.push_back({calls, bytes}); }
  // What there is against it; empty: nothing.
  std::string trouble() const {
    if (samples_.size() < 3) return "too few rounds to tell whether calls leave something";
    const Sample early = median(1), late = median(2);
    const std::size_t calls = late.calls - early.calls;
    // gRPC keeps traces of past connections, up to a limit of its own. A call that is never freed is some kB.
    constexpr std::size_t kTraces = 2'000'000, kPerCall = 50;
    if (late.bytes < early.bytes + kTraces + kPerCall * calls) return "";
    return fmt::format("{} calls left {:.2f} MB", calls,
                       1e-6 * static_cast<double>(late.bytes - early.bytes));
  }

 private:
  struct Sample {
    std::size_t calls, bytes;
  };
  Sample median(std::size_t third) const {
    const auto at = [&](std::size_t k) {
      return samples_.begin() + static_cast<std::ptrdiff_t>(k * samples_.size() / 3);
    };
    std::vector<Sample> part(at(third), at(third + 1));
    const auto middle = part.begin() + static_cast<std::ptrdiff_t>(part.size() / 2);
    std::nth_element(part.begin(), middle, part.end(), [](auto& a, auto& b) { return a.bytes < b.bytes; });
    return *middle;
  }
  std::vector<Sample> samples_;
};

// Said when the process dies under it: what to look at, and how soon it came.
const Tally* dying = nullptr;
extern "C" void say_where(int signal) {
  char line[100];
  const int length = std::snprintf(line, sizeof line, "the process died (signal %d) after %zu calls\n",
                                   signal, dying->calls());
  [[maybe_unused]] const auto written = write(STDOUT_FILENO, line, static_cast<std::size_t>(length));
  std::signal(signal, SIG_DFL);
  std::raise(signal);
}

class Cancellation : public testing::Test {
 protected:
  explicit Cancellation(std::vector<Share> shares_ = {{Method::kGetInfo, 1},
                                                      {Method::kEstimate, 3},
                                                      {Method::kCreateScene, 1},
                                                      {Method::kGetSceneBasic, 1},
                                                      {Method::kGetSceneFull, 1},
                                                      {Method::kListScenes, 1},
                                                      {Method::kDeleteScene, 1},
                                                      {Method::kTouch, 4},
                                                      {Method::kWatchFinger, 2},
                                                      {Method::kObserve, 2},
                                                      {Method::kHealthCheck, 1},
                                                      {Method::kHealthWatch, 1}})
      : shares(std::move(shares_)) {
    make_pairs();
    dying = &tally;
    service::rpc_device();  // has a handler of its own
    std::signal(SIGABRT, say_where);
    std::printf("seed %llu (TELETACT_FUZZ_SEED)\n", static_cast<unsigned long long>(seed));
    std::fflush(stdout);
  }
  ~Cancellation() override { std::signal(SIGABRT, SIG_DFL); }

  void calls_on(Service& service, ServiceState state, const Targets& targets) {
    Traffic traffic(service.address(), random.engine()(), tally);
    for (const Case& tried : shuffled_cases(state, shares, random)) traffic.start(tried, targets);
    traffic.wait();
  }
  void starting(Service& passing);
  void draining(Service& passing);
  void round(Service& steady);
  // So many calls, or one in `share` of them.
  void rounds(std::size_t share = 1);
  std::vector<std::string> unmet() const;

  const std::uint64_t seed = number_in("TELETACT_FUZZ_SEED", 1);
  const std::size_t wanted = number_in("TELETACT_FUZZ_CALLS", kAllCalls);
  const std::vector<Share> shares;
  Random random{seed};
  Tally tally;
};

// The service becomes ready under the calls.
void Cancellation::starting(Service& passing) {
  const auto all = shuffled_cases(ServiceState::kStarting, shares, random);
  const std::size_t ready_at = random.below(all.size());
  std::jthread starter;
  Traffic traffic(passing.address(), random.engine()(), tally);
  for (std::size_t k = 0; k < all.size(); ++k) {
    if (k == ready_at) starter = std::jthread([&] { passing.make_ready(); });
    traffic.start(all[k], usual_targets());
  }
  traffic.wait();
}

// Calls are first told that it drains; then its connections go, too.
void Cancellation::draining(Service& passing) {
  const auto all = shuffled_cases(ServiceState::kDraining, shares, random);
  const std::size_t told_at = random.below(all.size() / 4),
                    gone_at = told_at + 1 + random.below(all.size() / 2);
  std::jthread drainer;
  Traffic traffic(passing.address(), random.engine()(), tally);
  for (std::size_t k = 0; k < all.size(); ++k) {
    if (k == told_at) passing.calls().drain();
    if (k == gone_at) drainer = std::jthread([&] { passing.running()->drain(); });
    traffic.start(all[k], usual_targets());
  }
  traffic.wait();
}

void Cancellation::round(Service& steady) {
  Bystander undisturbed(steady.running().channel(), "still", kUndisturbedPeriodS);
  {
    Service passing(false);
    starting(passing);
    passing.expect_calls(0, "starting");
    draining(passing);
    passing.expect_calls(0, "draining");
  }
  const Targets targets = usual_targets();
  for (std::size_t k = 0; k < targets.made.size(); k += 3)  // or hardly a call deletes one that is there
    steady.create(service::uniform_scene(targets.made[k], 10e3, 0.02, 0.01));
  calls_on(steady, ServiceState::kServing, targets);
  steady.expect_calls(1, "serving");
  {
    const Full full(steady);
    calls_on(steady, ServiceState::kFull, usual_targets());
  }
  steady.sweep();
  steady.expect_calls(1, "being full");
  {
    const Deleting deleting(steady);
    calls_on(steady, ServiceState::kDeleted, Deleting::targets());
  }
  steady.expect_calls(1, "scenes deleted");
  undisturbed.stop();
  EXPECT_EQ(undisturbed.failures(), 0) << "the undisturbed client met something but OK";
  steady.expect_calls(0, "all");
  steady.sweep();
  EXPECT_EQ(steady.scenes().size(), Service::kScenes);
  steady.expect_bytes_of_calls_returned();
}

// Some ends are met once in thousands of calls, and gRPC and the allocator take some thousands to hold what
// they will. So fewer than all calls go on, up to all, until nothing is left to say against them.
void Cancellation::rounds(std::size_t share) {
  constexpr std::size_t kThreads = 8;  // gRPC's own come and go
  const std::size_t calls = wanted / share, most = std::max(wanted, kAllCalls) / share;
  Service steady(true);
  Growth growth;
  std::size_t threads_before = 0;
  const auto is_enough = [&] {
    return tally.calls() >= most || (tally.calls() >= calls && growth.trouble().empty() && unmet().empty());
  };
  while (!is_enough() && !HasFailure()) {
    round(steady);
    growth.add(tally.calls(), allocated_bytes());
    if (threads_before == 0) threads_before = threads();
    std::printf("%zu calls, %.1f MB, %zu threads\n", tally.calls(),
                static_cast<double>(allocated_bytes()) * 1e-6, threads());
    std::fflush(stdout);
  }
  std::printf("%s", tally.table().c_str());
  EXPECT_EQ(growth.trouble(), "");
  EXPECT_LE(threads(), threads_before + kThreads);
  for (const std::string& line : tally.unlisted()) ADD_FAILURE() << line;
  for (const std::string& line : unmet()) ADD_FAILURE() << line;
}

// Where the calls were meant to go and did not: each case is to be tried, and each end met at least once.
std::vector<std::string> Cancellation::unmet() const {
  using grpc::StatusCode;
  std::vector<Method> methods;
  for (const Share& share : shares) methods.push_back(share.method);
  std::vector<std::string> all;
  for (const std::string& name : tally.untried(methods)) all.push_back(name + ": never tried");
  const auto expect = [&](Method method, ServiceState state, std::optional<End> end, StatusCode code) {
    const auto is_it = [&](const Case& c, StatusCode s) {
      return c.method == method && c.state == state && (!end || c.end == *end) && s == code;
    };
    if (tally.count(is_it) > 0) return;
    all.push_back(fmt::format("{}, {}{}: never {}", name_of(method), name_of(state),
                              end ? fmt::format(", {}", name_of(*end)) : "", name_of(code)));
  };
  const auto is_health = [](Method m) { return m == Method::kHealthCheck || m == Method::kHealthWatch; };
  for (const Method method : methods) {
    expect(method, ServiceState::kServing, End::kCancel, StatusCode::CANCELLED);
    expect(method, ServiceState::kServing, End::kNoRead, StatusCode::CANCELLED);
    expect(method, ServiceState::kServing, End::kDeadline, StatusCode::DEADLINE_EXCEEDED);
    expect(method, ServiceState::kServing, End::kReset, StatusCode::UNAVAILABLE);
    if (method != Method::kHealthWatch) expect(method, ServiceState::kServing, {}, StatusCode::OK);
    if (is_health(method) || method == Method::kGetInfo) continue;
    expect(method, ServiceState::kStarting, {}, StatusCode::UNAVAILABLE);
    expect(method, ServiceState::kDraining, {}, StatusCode::UNAVAILABLE);
    if (sends_one(method)) continue;
    expect(method, ServiceState::kFull, {}, StatusCode::RESOURCE_EXHAUSTED);
    expect(method, ServiceState::kDeleted, {}, StatusCode::NOT_FOUND);
  }
  expect(Method::kTouch, ServiceState::kDeleted, {}, StatusCode::ABORTED);
  return all;
}

TEST_F(Cancellation, AnyCallEndedAtAnyPointLeavesTheServiceAsItWas) {
  rounds();
}

// The streams alone: for the thread sanitizer, and closer together.
class StreamCancellation : public Cancellation {
 protected:
  StreamCancellation()
      : Cancellation({{Method::kTouch, 8}, {Method::kWatchFinger, 3}, {Method::kObserve, 3}}) {}
};

TEST_F(StreamCancellation, EndedTouchAndWatchLeaveNothing) {
  rounds(5);
}

}  // namespace
}  // namespace teletact::test
