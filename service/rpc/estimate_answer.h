// What an estimate found, as messages: one for each map that was asked for, then the summary.
#pragma once

#include <cstddef>
#include <optional>

#include "service/imaging/estimate.h"
#include "service/rpc/acquisition.h"
#include "service/scene/scene.h"
#include "teletact/v1/elastography.pb.h"

namespace teletact::service {

struct EstimateOutcome {
  Estimate estimate;
  std::optional<Published> published;
  // waited_s: of the time since the upload, while others had their turn.
  double publish_s = 0, received_to_published_s = 0, queued_s = 0, waited_s = 0;
};

v1::EstimateStage stage_to(Stage);

// Message `index` of the answer into `out`; false when there is none any more.
bool answer_to(const EstimateOutcome&, const EstimateRequest&, std::size_t index, v1::EstimateResponse* out);

}  // namespace teletact::service
