// One touch stream as a load: closed loop (the next pose when the answer is there) or open loop (poses at a
// fixed rate, whatever comes back).
#pragma once

#include <grpcpp/channel.h>

#include <cstdint>
#include <memory>
#include <string>
#include <vector>

#include "teletact/v1/palpation.grpc.pb.h"

namespace teletact::bench {

struct LoadOptions {
  std::string scene_id;
  double begin_m = 0, end_m = 0;  // poses sweep to and fro between these
  double indentation_m = 0.003;
  double speed_m_s = 0.12;
  double duration_s = 5;
  double rate_hz = 0;  // poses per second; 0 = closed loop
};

// The widest range of a scene that windows cover without a gap, 8 mm inside. Throws BenchError.
LoadOptions load_over(const std::shared_ptr<grpc::Channel>& channel, const std::string& scene_id);

struct LoadResult {
  std::uint64_t poses = 0, answers = 0, without_force = 0;
  double elapsed_s = 0;
  // Of each pose that it or a later one was answered. Closed loop: written to received. Open loop: since the
  // pose was due, so that a stalled sender or service counts.
  std::vector<double> latency_s;
  std::vector<double> answered_s;  // of each: when the answer came, since the stream's first pose
};

// Runs one stream for options.duration_s. Throws BenchError when the service refuses or ends it.
LoadResult run_load(const std::shared_ptr<grpc::Channel>& channel, const LoadOptions& options,
                    unsigned client);

// The answer to one pose, on a stream of its own. Throws BenchError for one without force.
teletact::v1::TouchAnswer touch_once(const std::shared_ptr<grpc::Channel>& channel,
                                     const std::string& scene_id, double x_m, double indentation_m);

}  // namespace teletact::bench
