// summary.json of a session: what was measured, in SI units, against what the project promises.
#pragma once

#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "client/report/force_error.h"
#include "client/report/inclusions.h"
#include "client/report/promise.h"
#include "client/report/session_record.h"

namespace teletact::client {

// The scene's stitched modulus; values that were not measured are NaN. Throws std::runtime_error when the
// recording holds no scene.
ModulusGrid measured_modulus(const AcquireRecord& record);

// Keys: windows, stalls {count, s}, window_s {p50, p95, max}, window_request_s, touch_rate_hz,
// touch_latency_s {p50, p99, max}, round_trip_s, by_law_share (of the time with force on), degraded,
// service_degraded, faded {count, s} (null: not recorded), largest_claim {of, lacks_j} (energy that was
// refused; null: not recorded), servo {rate_hz, overruns, lateness_s_p99},
// force_error {median, p95, coverage}, inclusions {true, found, false, missed}, device, versions, targets.
// window_s and window_request_s are of the windows published while touching went on
// (`windows_while_touching`). An inclusion where no window was acquired is not missed.
nlohmann::json summarise(const Tissue& tissue, const TouchRecord& touch, const AcquireRecord& acquire,
                         const ForceError& force, const InclusionReport& inclusions,
                         const std::string& client_version);

// Of a touch alone: those of its keys that such a recording tells, and tactile {images, malformed}.
nlohmann::json summarise(const TouchRecord& touch, const std::string& client_version);

// The promised figures of a summary, of a demo or of a touch alone; also written into it as `targets`.
std::vector<Promise> promises_of(const nlohmann::json& summary);
// As `targets`; then whether all are met.
bool set_targets(nlohmann::json& summary, const std::vector<Promise>& promises);

// A table for people, and what of the targets is not met.
std::string readable(const nlohmann::json& summary);
std::string not_met(const nlohmann::json& summary);

}  // namespace teletact::client
