// Between the contract's messages and what the servo speaks.
#pragma once

#include <optional>

#include "client/servo/servo_loop.h"
#include "teletact/v1/palpation.pb.h"
#include "teletact/v1/recording.pb.h"

namespace teletact::client {

// [x, y] or [x, y, z], z being 0 where it is absent; none of another length.
std::optional<Vector3> vector_from(const google::protobuf::RepeatedField<double>& xyz);

// None of what is not finite, and of a normal that is no unit vector.
std::optional<TouchedSurface> surface_from(const v1::Layer& layer);
std::optional<Region> region_from(const v1::Region& region);

// None when the answer lacks a field or has one of the wrong length: it is dropped, never guessed.
// `surface` and `period_s` are the stream's (TouchOpened).
std::optional<ServoAnswer> to_servo_answer(const v1::TouchAnswer& answer, const TouchedSurface& surface,
                                           double period_s, std::int64_t received_ns);

// `sequence` strictly increasing; `acknowledged` the last answer received.
v1::TouchRequest to_request(const ServoPose& pose, std::uint64_t sequence, std::uint64_t acknowledged,
                            std::uint64_t instance);

v1::RecordEntry to_record(const ServoTick& tick);

}  // namespace teletact::client
