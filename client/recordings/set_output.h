// Estimates of several pairs on disk: each pair's own maps, each place's modulus joined of them, and the
// volume of several planes.
#pragma once

#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "client/acquire/estimate_client.h"
#include "client/recordings/joined_modulus.h"
#include "client/recordings/recorded_set.h"
#include "teletact/v1/info.pb.h"

namespace teletact::client {

struct EstimatedPair {
  RecordedFrameOptions frames;
  teletact::v1::Acquisition acquisition;
  std::string made;         // FramePair::made
  EstimateOutcome outcome;  // without maps: refused
  std::string refusal;      // the service's; empty: estimated
};

// One image plane.
struct EstimatedPlace {
  std::optional<double> z_m;
  std::vector<EstimatedPair> pairs;
  JoinedModulus joined;  // of those that were not refused; nothing used: of none
  // Of each pair, in their order: why it was left out; empty: used.
  std::vector<std::string> left_out;
  bool absolute = false;     // the modulus is in Pa
  double correlation_m = 0;  // of its errors: the longest of the pairs used
  double background = 0;     // median, Pa or 1
  std::vector<std::string> assumed, warnings;
};

// Throws std::runtime_error where the service sent maps that do not lie on one grid.
EstimatedPlace join_place(std::optional<double> z_m, std::vector<EstimatedPair> pairs);

// pair-1, pair-2 ... (write_estimate), modulus.vti, .png, .nc and estimate.json of all. Returns the files'
// names. Throws FileError.
std::vector<std::string> write_place(const std::filesystem::path& folder, const EstimatedPlace& place,
                                     const teletact::v1::GetInfoResponse& info);

// slice-1, slice-2 ... (write_place, where a pair was used), volume.vti, .png, .nc and estimate.json. Of a
// plane without a modulus nothing is valid. Throws std::invalid_argument where no plane has one.
std::vector<std::string> write_volume(const std::filesystem::path& folder,
                                      const std::vector<EstimatedPlace>& places,
                                      const teletact::v1::GetInfoResponse& info);

}  // namespace teletact::client
