// What is to be estimated of a pair of RF frames: as its client states it, and once settled with all that was
// left out.
#pragma once

#include <chrono>
#include <cmath>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "service/imaging/estimate.h"
#include "service/imaging_plane/estimate_cost.h"
#include "service/scene/scene.h"

namespace teletact::service {

// 0 and empty: not stated. What the scene and the time tell of the pair is filled in when its turn has come.
struct EstimateRequest : EstimateInput {
  EstimateRequest() { tissue = {0, 0, 0, 0}; }
  std::size_t sample_count = 0, line_count = 0;
  // Of ProbeForce in the contract; what settle() makes of it is in `force`, and over force and area here.
  double force_std_n = 0, contact_area_std_m2 = 0;
  double force_zero_n = 0, force_zero_std_n = 0, force_gain = 0, force_gain_std = 0;
  double force_relative_deviation = 0, area_relative_deviation = 0;
  double sound_speed_std_m_s = 0, tissue_width_std_m = 0, preload_m = 0, preload_std_m = 0;
  double max_strain = 0;
  std::optional<double> modulus_time_limit_s;  // > 0
  double max_modulus_s = HUGE_VAL;             // that it may take in any case
  std::shared_ptr<Scene> scene;                // null: nothing is published
  double window_x_m = 0;
  // Of a solid: whose slices tell how the tissue goes on across the image; where its left border lies there.
  struct SceneSlice {
    std::shared_ptr<Scene> scene;
    double x_m = 0, z_m = 0;
  };
  std::optional<SceneSlice> slice_of;
  double finish_within_s = 0;     // of the last byte; 0: whenever
  std::vector<std::string> maps;  // wanted: names, of kEstimateMaps

  double window_width_m() const { return geometry.line_pitch_m * static_cast<double>(line_count); }
  std::size_t samples() const { return sample_count * line_count; }
  EstimateSize size() const;
  // Whether its modulus is found as it is planned: by a quicker method where time is short.
  bool planned() const { return !modulus.kind && tissue.plane != Plane::kSolid; }
};

// Checks what is stated and fills in the rest: by the scene, else by what is usual. Throws
// std::invalid_argument (field named as in the contract), Error(kPrecondition).
void settle(EstimateRequest&, const Limits&);

// What makes an estimate doubtful, each "name: words for people".
std::vector<std::string> warnings_of(const Estimate&);

// What is published of an estimate. `received`: when the last byte of its frames came in.
WindowEstimate window_of(const EstimateRequest&, const Estimate&,
                         std::chrono::steady_clock::time_point received);

}  // namespace teletact::service
