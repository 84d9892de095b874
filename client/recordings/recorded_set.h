// Several pairs of recorded frames: of one place, or of planes that lie side by side.
#pragma once

#include <filesystem>
#include <optional>
#include <vector>

#include "client/acquire/recorded_frames.h"

namespace teletact::client {

// As options give them: each once, for all pairs, or once for each pair.
struct RecordedSetOptions {
  RecordedFrameOptions common;  // all but what follows
  std::vector<std::filesystem::path> pre, post;
  std::vector<std::string> post_variable;  // empty: as of pre
  std::vector<std::size_t> pre_frame, post_frame;
  std::vector<double> force_n;
  std::vector<double> z_m;  // of each pair's image plane; empty: all are of one place
};

// Pairs of one image plane.
struct RecordedPlace {
  std::optional<double> z_m;
  std::vector<RecordedFrameOptions> pairs;
};

// Places in the order of their z. Throws FrameInputError: an option that is given neither once nor for each
// pair, planes that do not lie evenly apart (a volume has one spacing).
std::vector<RecordedPlace> recorded_places(const RecordedSetOptions& options);

// Throws FrameInputError where a pair's frames do not have the samples, lines and spacings of the first's.
// All files are read once, so that a bad one is known before anything is computed.
void require_one_geometry(const std::vector<RecordedPlace>& places);

}  // namespace teletact::client
