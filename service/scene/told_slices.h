// What the strain at a solid's slices last told of the tissue that they share, published or not. Kept
// on disk with the versions that are published.
#pragma once

#include <map>
#include <mutex>
#include <string>
#include <utility>
#include <vector>

#include "service/base/memory.h"
#include "service/imaging/modulus/tissue_extent.h"
#include "service/scene/scene_record.h"

namespace teletact::service {

class ToldSlices {
 public:
  static constexpr std::size_t kMost = 64;
  explicit ToldSlices(MemoryAccount account = {}) : account_(std::move(account)) {}
  // In the place of what a slice there told before; an empty one tells nothing, and changes nothing. So does
  // one for which there is no memory: that is logged. `words`: what the estimate took the tissue to be, and
  // where.
  void tell(double z_m, std::vector<ToldTissue>, const std::string& words);
  // Where the solid has slices, but for one at z_m.
  std::vector<ToldBeside> beside(const ExplicitModulus&, double z_m) const;
  ToldRecord all() const;
  std::string words() const;

 private:
  struct Told {
    std::vector<ToldTissue> tissues;
    Charge held;
  };
  const MemoryAccount account_;
  mutable std::mutex mutex_;
  std::map<double, Told> told_;  // by z, m; kMost at most, the farthest from the newest go
  std::string words_;
};

}  // namespace teletact::service
