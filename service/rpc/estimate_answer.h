// What an estimate found, as messages: one for each map that was asked for, then the summary.
#pragma once

#include <cstddef>

#include "service/imaging_plane/imaging_plane.h"
#include "service/rpc/acquisition.h"
#include "teletact/v1/elastography.pb.h"

namespace teletact::service {

v1::EstimateStage stage_to(Stage);
const char* name_of(Stage);

// Message `index` of the answer into `out`; false when there is none any more.
bool answer_to(const EstimateOutcome&, const EstimateRequest&, std::size_t index, v1::EstimateResponse* out);

}  // namespace teletact::service
