// Stiff lumps in a volume of estimated slices, found without knowing the truth, and compared with it.
#pragma once

#include <cstddef>
#include <vector>

#include "client/files/metaimage.h"
#include "client/patient/tissue.h"

namespace teletact::bench {

struct FoundLump {
  double x_m = 0, y_m = 0, z_m = 0;  // centroid
  double diameter_m = 0;             // of the ball with its volume
  double contrast = 1;               // the largest in it over the background
};

struct LumpReport {
  double background_pa = 0;  // median of the volume
  std::vector<FoundLump> found;
  std::vector<int> match;             // for each true one: index into found, or -1
  std::vector<std::size_t> invented;  // found ones that are no true one's
};

// `volume`: Young's modulus along x, y and z, as `acquire --save-modulus` writes it, slices that are missing
// not a number. `truth` in its coordinates. What has at least sqrt(3) of contrast, half of the way to 3, with
// ln E straight between elements and slices, and as large as a ball of 5 mm; a true one is found when its
// centre is kLumpMatchM from a centroid at most. Throws BenchError for a volume that is none.
LumpReport find_lumps(const client::MetaImage& volume, const std::vector<client::Inclusion>& truth);

inline constexpr double kLumpMatchM = 0.003;

}  // namespace teletact::bench
