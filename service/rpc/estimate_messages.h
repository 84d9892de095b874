// proto <-> domain for estimates: what a client says about its RF pair, checked, the pair itself as its
// chunks come in, and what was found.
#pragma once

#include <cstddef>
#include <string>
#include <utility>
#include <vector>

#include "service/imaging_plane/estimate_request.h"
#include "service/imaging_plane/imaging_plane.h"
#include "service/scene/scenes.h"
#include "teletact/v1/elastography.pb.h"

namespace teletact::service {

namespace v1 = ::teletact::v1;

// Throws std::invalid_argument (field named), Error(kNotFound | kExhausted | kPrecondition); allocates
// nothing that the client sized.
EstimateRequest request_from(const v1::Acquisition&, const Scenes&, const Limits&);

// Puts the chunks of both frames together.
class FrameUpload {
 public:
  FrameUpload(const EstimateRequest&, v1::DataType of_samples, std::size_t max_chunk_bytes);
  std::size_t frame_bytes() const { return frame_bytes_; }
  // Throws std::invalid_argument for a chunk that does not continue its frame or has too many bytes.
  void add(const v1::FrameChunk&);
  // Throws std::invalid_argument when bytes are missing.
  void require_whole() const;
  // Pre and post. Throws as require_whole, and when a sample is not finite.
  std::pair<RfFrame, RfFrame> finish();

 private:
  void require_whole(const char* name, const std::string& bytes) const;
  RfFrame frame(const char* name, std::string& bytes) const;
  std::size_t samples_, lines_, frame_bytes_, max_chunk_bytes_;
  v1::DataType dtype_;
  std::string pre_, post_;
};

// What an estimate found, as messages: one for each map that was asked for, then the summary.
v1::EstimateStage stage_to(Stage);
const char* name_of(Stage);

// Message `index` of the answer into `out`; false when there is none any more.
bool answer_to(const EstimateOutcome&, const EstimateRequest&, std::size_t index, v1::EstimateResponse* out);

}  // namespace teletact::service
