// The force that was felt, with what was stated of it, against the force of the true tissue at the same pose
// of the same fingertip.
#pragma once

#include <optional>
#include <vector>

#include "client/patient/patient.h"
#include "client/report/session_record.h"

namespace teletact::client {

struct ForceSamplePoint {
  double time_s = 0, x_m = 0, indentation_m = 0;
  double felt_n = 0;  // along the push, > 0 resisting
  std::optional<ForceInterval> stated{};
  std::optional<double> true_n{};  // as felt_n; none: not known
  double relative_error = 0;       // |felt - true| / |true|, both as vectors; only where judged
  bool judged = false;
};

struct ForceError {
  double median = 0, p95 = 0;
  double coverage = 0;  // judged / all samples from the first touch to the last, start ramps left out
  std::size_t judged = 0;
  std::vector<ForceSamplePoint> samples;
};

// The ticks that are compared with a true force: every 10 ms from the first contact to the last, but none
// while force is ramped after it came on.
std::vector<TouchTick> felt_path(const std::vector<TouchTick>&);
// What was felt there, and what was stated of it.
std::vector<ForceSamplePoint> felt_force(const TouchRecord&);

// Throws std::runtime_error when nothing of the path can be judged, or when an interior layer was touched, or
// with a tip under which the true force is not known.
ForceError force_error(const Patient& patient, const TouchRecord& record);

}  // namespace teletact::client
