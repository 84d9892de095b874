// The rows of `real-tissue`: solids unlike what an estimator assumes, one level at a time, and all together.
#pragma once

#include <cstdint>
#include <functional>
#include <string>
#include <vector>

#include "client/patient/tissue.h"

namespace teletact::bench {

// Between 0 and 1, of a seed.
using Draw = std::function<double()>;

struct RealRow {
  std::string name;     // with its level
  double contrast = 1;  // of the lump of 10 mm, centre 12 to 18 mm deep; 1: no lump
  bool quick = false;   // one of those that a quick run has
  std::function<void(client::Tissue&, const Draw&)> set;  // on top of the plain tissue with its lump
};

std::vector<RealRow> real_rows();

// 120 x 40 mm of 10 kPa, 100 mm across, bonded, frictionless, a probe of 60 x 10 mm on its middle; a sphere
// where the row has contrast. Everything by the seed.
client::Tissue tissue_of(const RealRow& row, std::uint64_t seed);

}  // namespace teletact::bench
