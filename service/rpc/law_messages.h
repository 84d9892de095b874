// Pieces of contact laws -> proto.
#pragma once

#include "service/touch_plane/law_outbox.h"
#include "teletact/v1/palpation.pb.h"

namespace teletact::service {

namespace v1 = ::teletact::v1;

// A piece has one column at least.
void law_to(const LawPiece&, v1::LawPiece*);

}  // namespace teletact::service
