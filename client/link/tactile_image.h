// A tactile image as it came with an answer.
#pragma once

#include <cstddef>
#include <cstdint>
#include <optional>
#include <vector>

#include "teletact/v1/palpation.pb.h"

namespace teletact::client {

struct TactileImage {
  std::uint64_t sequence = 0;           // of the pose whose contact it shows
  double begin_x_m = 0, begin_z_m = 0;  // centre of the first taxel, in the scene
  std::size_t along_x = 0, along_z = 0;
  double pitch_m = 0;
  std::vector<float> pressure_pa;  // [z][x]
  std::vector<float> beyond_pa;    // beyond what homogeneous tissue shows at the same force; empty: not known
  double force_n = 0, outside_n = 0;
};

// None of what is malformed.
std::optional<TactileImage> tactile_from(const v1::TactileImage&);

}  // namespace teletact::client
