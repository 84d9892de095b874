// What a session adds up to, as recordings and whoever looks at it get it.
#pragma once

#include <cstdint>

#include "client/session/operator_session.h"
#include "teletact/v1/recording.pb.h"

namespace teletact::client {

// How much of a session's duration is over: the time with force on. Once an outage has lasted for `lost_s`,
// all that was lost counts too, so that a session whose force never comes back ends; shorter ones are made up
// for.
double spent_s(const TickStatistics& ticks, double lost_s);

// Answers to distinct poses, per second.
double touch_rate_hz(const TouchLinkStats& link);

v1::RecordEntry to_record(const TouchSummary& summary, std::int64_t now_ns);

}  // namespace teletact::client
