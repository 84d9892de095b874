// What a client says about its RF pair, checked, and the pair itself as its chunks come in.
#pragma once

#include <chrono>
#include <cstdint>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "service/imaging/estimate.h"
#include "service/imaging/estimate_cost.h"
#include "service/imaging/modulus/tissue_extent.h"
#include "service/imaging/tracking/frame.h"
#include "service/scene/scenes.h"
#include "service/scene/stitched_map.h"
#include "teletact/v1/elastography.pb.h"

namespace teletact::service {

namespace v1 = ::teletact::v1;

constexpr double kDefaultMaxStrain = 0.05;

struct EstimateRequest {
  std::size_t sample_count = 0, line_count = 0;
  v1::DataType dtype = v1::DATA_TYPE_UNSPECIFIED;
  AcquisitionGeometry geometry;
  std::optional<ProbeForce> force;
  double force_relative_deviation = 0, area_relative_deviation = 0;  // standard deviations, over the values
  TissueExtent tissue;
  double max_strain = kDefaultMaxStrain;
  ModulusChoice modulus;
  std::shared_ptr<Scene> scene;  // null: nothing is published
  double window_x_m = 0;
  std::vector<std::string> maps;  // names, of estimate_maps()
  double finish_within_s = 0;     // of the last byte; 0: whenever
  double window_width_m() const { return geometry.line_pitch_m * static_cast<double>(line_count); }
  std::size_t samples() const { return sample_count * line_count; }
  std::size_t frame_bytes() const;
  EstimateSize size() const;
};

// Throws std::invalid_argument (field named), Error(kNotFound | kExhausted | kPrecondition); allocates
// nothing that the client sized.
EstimateRequest request_from(const v1::Acquisition&, const Scenes&, const Limits&);

// What makes an estimate doubtful, each "name: words for people".
std::vector<std::string> warnings_of(const Estimate&);

// What is published of an estimate. `received`: when the last byte of its frames came in.
WindowEstimate window_of(const EstimateRequest&, const Estimate&,
                         std::chrono::steady_clock::time_point received);

// Puts the chunks of both frames together.
class FrameUpload {
 public:
  FrameUpload(const EstimateRequest&, std::size_t most_chunk_bytes);
  // Throws std::invalid_argument for a chunk that does not continue its frame or has too many bytes.
  void add(const v1::FrameChunk&);
  // Throws std::invalid_argument when bytes are missing.
  void require_whole() const;
  // Pre and post. Throws as require_whole, and when a sample is not finite.
  std::pair<RfFrame, RfFrame> finish();

 private:
  void require_whole(const char* name, const std::string& bytes) const;
  RfFrame frame(const char* name, std::string& bytes) const;
  std::size_t samples_, lines_, frame_bytes_, most_chunk_bytes_;
  v1::DataType dtype_;
  std::string pre_, post_;
};

}  // namespace teletact::service
