// What a session adds up to, as recordings and whoever looks at it get it.
#pragma once

#include <cstdint>

#include "client/session/operator_session.h"
#include "teletact/v1/recording.pb.h"

namespace teletact::client {

// Answers to distinct poses, per second.
double touch_rate_hz(const TouchLinkStats& link);

v1::RecordEntry to_record(const TouchSummary& summary, std::int64_t now_ns);

}  // namespace teletact::client
