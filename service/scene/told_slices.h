// What the strain at a solid's slices last told of the tissue that they share, published or not. Not kept on
// disk: after a restart slices tell it anew.
#pragma once

#include <map>
#include <mutex>
#include <vector>

#include "service/imaging/modulus/tissue_extent.h"
#include "service/scene/scene_record.h"

namespace teletact::service {

class ToldSlices {
 public:
  static constexpr std::size_t kMost = 64;
  // In the place of what a slice there told before; an empty one tells nothing, and changes nothing.
  void tell(double z_m, std::vector<ToldTissue>);
  // Where the solid has slices, but for one at z_m.
  std::vector<ToldBeside> beside(const ExplicitModulus&, double z_m) const;

 private:
  mutable std::mutex mutex_;
  std::map<double, std::vector<ToldTissue>> told_;  // by z, m; kMost at most, the farthest from the newest go
};

}  // namespace teletact::service
