// proto <-> domain for touch. Everything that comes in is checked; std::invalid_argument names the field as
// the contract does and says what to do.
#pragma once

#include "service/touch_plane/law_outbox.h"
#include "service/touch_plane/touch_stream.h"
#include "teletact/v1/palpation.pb.h"

namespace teletact::service {

namespace v1 = ::teletact::v1;

TouchStreamOptions stream_options_from(const v1::TouchOpen&);
FingerPose pose_from(const v1::ContactPose&);
// `instance`: the process', for stamps. The caller adds when it was answered.
void answer_to(const TouchStream::Answered&, std::uint64_t instance, v1::TouchAnswer*);
// A piece has one column at least.
void law_to(const LawPiece&, v1::LawPiece*);

}  // namespace teletact::service
