// teletact-proxy: a far service on this machine. Passes connections on to a service, with the round trip, the
// jitter and the rate of a long or narrow link, until it is ended.
#include <fcntl.h>
#include <unistd.h>

#include <CLI/CLI.hpp>
#include <array>
#include <csignal>
#include <cstdio>
#include <ctime>
#include <exception>
#include <string>
#include <vector>

#include "tests/support/fault_proxy.h"

namespace {

using teletact::test::DirectionFaults;
using teletact::test::FaultEvent;
using teletact::test::FaultProxy;

// A word of whoever controls the link; `usual`: what it is given by.
std::vector<FaultEvent> faults_of(const std::string& word, const DirectionFaults& usual) {
  using Kind = FaultEvent::Kind;
  constexpr double kStallS = 1, kCutS = 2;
  const DirectionFaults jitter{.delay_s = 0.005, .jitter_s = 0.05}, far{.delay_s = 0.1};
  if (word == "stall") return {{.kind = Kind::kStall, .seconds = kStallS}};
  if (word == "jitter") return {{.faults = {jitter, jitter}}};
  if (word == "far") return {{.faults = {far, far}}};
  // Stalled first: whoever connects at once after the reset meets a dead link, too.
  if (word == "cut") return {{.kind = Kind::kStall, .seconds = kCutS}, {.kind = Kind::kReset}};
  if (word == "none") return {{.faults = {usual, usual}}};
  return {};
}

// Until a signal ends it: what whoever controls the link says meanwhile.
void run(const sigset_t& ends, int control, FaultProxy& proxy, const DirectionFaults& usual) {
  constexpr timespec kLook{.tv_sec = 0, .tv_nsec = 50'000'000};
  std::string said;
  std::array<char, 256> buffer{};
  while (sigtimedwait(&ends, nullptr, &kLook) < 0) {
    const ssize_t got = control < 0 ? 0 : ::read(control, buffer.data(), buffer.size());
    if (got > 0) said.append(buffer.data(), static_cast<std::size_t>(got));
    for (std::size_t end = 0; (end = said.find('\n')) != std::string::npos; said.erase(0, end + 1))
      for (const FaultEvent& event : faults_of(said.substr(0, end), usual)) proxy.play(event);
  }
}

}  // namespace

int main(int argc, char** argv) {
  CLI::App app("teletact-proxy: a service of this machine as over a long or narrow link", "teletact-proxy");
  std::string service, control;
  double round_trip_ms = 0, jitter_ms = 0, kbit_s = 0;
  const CLI::Range milliseconds(0.0, 10e3);
  app.add_option("--service", service, "unix:/PATH or 127.0.0.1:PORT, to pass connections on to")->required();
  app.add_option("--round-trip-ms", round_trip_ms, "that is added, half of it each way")->check(milliseconds);
  app.add_option("--jitter-ms", jitter_ms, "the round trip is so much shorter or longer, evenly at random")
      ->check(milliseconds);
  app.add_option("--kbit-s", kbit_s, "each way; 0: not limited")->check(CLI::Range(0.0, 1e9));
  app.add_option(
      "--control", control,
      "named pipe that says, a word a line, what becomes of the link: stall, jitter, far, cut, none");
  CLI11_PARSE(app, argc, argv);
  if (jitter_ms > round_trip_ms) {
    std::fprintf(stderr, "--jitter-ms %g: more than the round trip of %g ms\n", jitter_ms, round_trip_ms);
    return 1;
  }
  const int pipe = control.empty() ? -1 : ::open(control.c_str(), O_RDONLY | O_NONBLOCK | O_CLOEXEC);
  if (!control.empty() && pipe < 0) {
    std::fprintf(stderr, "--control %s: cannot be read; make it by mkfifo\n", control.c_str());
    return 1;
  }
  sigset_t ends;
  sigemptyset(&ends);
  for (const int signal : {SIGINT, SIGTERM}) sigaddset(&ends, signal);
  pthread_sigmask(SIG_BLOCK, &ends, nullptr);  // before there are other threads
  try {
    teletact::test::FaultProxy proxy(service);
    const DirectionFaults way{.delay_s = (round_trip_ms - jitter_ms) / 2e3,
                              .jitter_s = jitter_ms / 1e3,
                              .bandwidth_bytes_s = kbit_s * 1e3 / 8};
    proxy.play({.faults = {way, way}});
    std::printf("passing on at %s\n", proxy.address().c_str());
    std::fflush(stdout);
    run(ends, pipe, proxy, way);
    std::printf("passed on %.1f kB to the service and %.1f kB from it\n",
                1e-3 * static_cast<double>(proxy.bytes_up()), 1e-3 * static_cast<double>(proxy.bytes_down()));
  } catch (const std::exception& error) {
    std::fprintf(stderr, "teletact-proxy: %s\n", error.what());
    return 1;
  }
  return 0;
}
