// One process's part of a load.
#pragma once

#include <string>
#include <vector>

#include "bench/load/arrivals.h"
#include "bench/load/tally.h"
#include "client/link/credentials.h"

namespace teletact::client {
NLOHMANN_DEFINE_TYPE_NON_INTRUSIVE(Credentials, tls_ca, tls_certificate, tls_key, token)
}

namespace teletact::bench {

struct LoadPlan {
  std::string address;
  std::vector<std::string> scene_ids;  // clients take turns
  client::Credentials credentials;
  double begin_m = 0, end_m = 0, indentation_m = 0.003, speed_m_s = 0.12;  // where fingers sweep
  std::string recording;  // of a touch, that they do in place of that, at its own instants; empty: none
  unsigned first_client = 0, clients = 1, in_flight = 8;
  bool closed_loop = false, poisson = false, laws = false, greedy = false;
  double rate_hz = 100, end_rate_hz = 100;  // of each client; not in the closed loop
  double warm_up_s = 1, duration_s = 10;    // the first is not counted
  double stay_s = 0;        // of a stream on average, then another takes its place; 0: streams stay
  double cancel_share = 0;  // of the streams that go: drop the call as it stands
  std::uint64_t seed = 1;
  std::int64_t begin_ns = 0;  // on the machine's monotonic clock, the same for all processes
};
NLOHMANN_DEFINE_TYPE_NON_INTRUSIVE(LoadPlan, address, credentials, scene_ids, begin_m, end_m, indentation_m,
                                   speed_m_s, recording, first_client, clients, in_flight, closed_loop,
                                   poisson, laws, greedy, rate_hz, end_rate_hz, warm_up_s, duration_s, stay_s,
                                   cancel_share, seed, begin_ns)

// Blocks until all streams have ended. A stream that is refused, or fails, is counted; where streams do not
// stay, another is opened when its time has come.
Tally run_worker(const LoadPlan&);

}  // namespace teletact::bench
