// teletact-proxy: a far service on this machine. Passes connections on to a service, with the round trip, the
// jitter and the rate of a long or narrow link, until it is ended.
#include <CLI/CLI.hpp>
#include <csignal>
#include <cstdio>
#include <exception>

#include "tests/support/fault_proxy.h"

int main(int argc, char** argv) {
  CLI::App app("teletact-proxy: a service of this machine as over a long or narrow link", "teletact-proxy");
  std::string service;
  double round_trip_ms = 0, jitter_ms = 0, kbit_s = 0;
  const CLI::Range milliseconds(0.0, 10e3);
  app.add_option("--service", service, "unix:/PATH or 127.0.0.1:PORT, to pass connections on to")->required();
  app.add_option("--round-trip-ms", round_trip_ms, "that is added, half of it each way")->check(milliseconds);
  app.add_option("--jitter-ms", jitter_ms, "the round trip is so much shorter or longer, evenly at random")
      ->check(milliseconds);
  app.add_option("--kbit-s", kbit_s, "each way; 0: not limited")->check(CLI::Range(0.0, 1e9));
  CLI11_PARSE(app, argc, argv);
  if (jitter_ms > round_trip_ms) {
    std::fprintf(stderr, "--jitter-ms %g: more than the round trip of %g ms\n", jitter_ms, round_trip_ms);
    return 1;
  }
  sigset_t ends;
  sigemptyset(&ends);
  for (const int signal : {SIGINT, SIGTERM}) sigaddset(&ends, signal);
  pthread_sigmask(SIG_BLOCK, &ends, nullptr);  // before there are other threads
  try {
    teletact::test::FaultProxy proxy(service);
    const teletact::test::DirectionFaults way{.delay_s = (round_trip_ms - jitter_ms) / 2e3,
                                              .jitter_s = jitter_ms / 1e3,
                                              .bandwidth_bytes_s = kbit_s * 1e3 / 8};
    proxy.play({.faults = {way, way}});
    std::printf("passing on at %s\n", proxy.address().c_str());
    std::fflush(stdout);
    int ended = 0;
    sigwait(&ends, &ended);
    std::printf("passed on %.1f kB to the service and %.1f kB from it\n",
                1e-3 * static_cast<double>(proxy.bytes_up()), 1e-3 * static_cast<double>(proxy.bytes_down()));
  } catch (const std::exception& error) {
    std::fprintf(stderr, "teletact-proxy: %s\n", error.what());
    return 1;
  }
  return 0;
}
