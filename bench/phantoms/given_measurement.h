// What tracking would have said of a displacement that is known: noise of a stated size and structure, and
// the strain that the product makes of it. For whatever comes after tracking, without RF.
#pragma once

#include <cstdint>
#include <vector>

#include "service/device/queue.h"
#include "service/imaging/tracking/measured.h"

namespace teletact::bench {

// Of a window 60 x 40 mm, which is used where none else is given.
inline constexpr service::ImageGrid kGivenImage{127, 98, 0.35e-3, 0.2e-3, 0.47e-3, 0.404e-3};

struct GivenDisplacement {
  std::vector<double> axial_m, lateral_m;  // at the nodes of the image
  std::vector<std::uint8_t> trusted;       // empty: everywhere
  double noise_m = 0.5e-6;  // standard deviation of the axial one, ten times that of the lateral
  service::ImageGrid image = kGivenImage;
};

service::Measured measured_of(const service::Queue&, const GivenDisplacement&, std::uint64_t seed);

}  // namespace teletact::bench
