// Recorded RF from files: two frames and their geometry, ready to upload. Geometry comes from the file where
// it has it; what is missing is asked for by name; what contradicts is refused.
#pragma once

#include <filesystem>
#include <optional>
#include <stdexcept>
#include <string>

#include "client/acquire/frame_source.h"

namespace teletact::client {

// One line for the user, naming the option that helps.
struct FrameInputError : std::runtime_error {
  using std::runtime_error::runtime_error;
};

struct RecordedFrameOptions {
  std::filesystem::path pre, post;  // .mha, .mhd (MetaImage), .mat (MATLAB v5, v7.3), .uff (USTB)
  double center_frequency_hz = 0;
  double sampling_frequency_hz = 0;               // 0: not stated; a .uff file states the distance of samples
  std::optional<double> sound_speed_m_s;          // of none, the file's, or 1540
  std::optional<double> modulation_frequency_hz;  // .uff: of complex data, where the file does not state it
  std::optional<double> line_pitch_m;
  std::string frame;  // "LAB" or "PROBE"
  std::optional<double> force_n, contact_area_m2;
  std::string variable;                              // .mat: name of the RF variable; .uff: of the object
  std::string post_variable;                         // of post; empty: the same
  std::string axial_axis;                            // .mat: "rows" or "columns"
  std::optional<std::size_t> pre_frame, post_frame;  // of a file with several frames: which, from 0
  std::string spacing_unit = "m";                    // of the MetaImage header: "m" or "mm"
  // The service's defaults, sent as stated: on the wire a 0 would stand for them, so none can be given.
  double max_strain = 0.05, poisson_ratio = 0.49;
  double tissue_depth_m = 0, tissue_width_m = 0;  // 0: the frame's
  // 0: the service's default
  teletact::v1::ModulusMethod modulus_method = teletact::v1::MODULUS_METHOD_UNSPECIFIED;
  double modulus_time_limit_s = 60;  // nobody waits with a finger: until it has settled
  // Unspecified: a solid, or plane strain where a method of planes is given.
  teletact::v1::PlaneCondition plane = teletact::v1::PLANE_CONDITION_UNSPECIFIED;
  double probe_elevation_m = 0;           // of a solid; 0: by the contact area, or fitted
  teletact::v1::Acquisition stated = {};  // what else is, of uncertainties; the rest is not set
};

// Reads both frames. Throws FrameInputError, and FileError for files that cannot be read.
FramePair read_recorded_frames(const RecordedFrameOptions& options);

// The tissue that the service takes for a plane: as stated in the request, or else the frame. Of a solid
// nothing is assumed here: the summary's modulus_model says what was assumed and fitted; 0: not stated.
struct TissueExtent {
  double width_m = 0, depth_m = 0;
  bool width_assumed = false, depth_assumed = false;
};
TissueExtent tissue_extent(const teletact::v1::Acquisition& acquisition);

// A question for people where no soft tissue has such a modulus (100 Pa to 1 MPa): another unit was meant.
// Else empty.
std::string modulus_doubt(double background_pa);

}  // namespace teletact::client
