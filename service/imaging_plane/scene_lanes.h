// Which device images which scene, and in which of its turns: those with the fewest scenes when it is first
// imaged, and those from then on. A scene whose device does not work goes to another that does, and stays
// there. Thread-safe.
#pragma once

#include <cstddef>
#include <cstdint>
#include <map>
#include <memory>
#include <mutex>
#include <vector>

namespace teletact::service {

class Scene;

class SceneLanes {
 public:
  struct Lane {
    bool works = true;
    double load_s = 0;  // until it would be done there
    std::size_t device = 0;
  };
  // The number of the lane. Of lanes with as many scenes it is the least loaded. Where no lane works, it is
  // the scene's own. `scene` null: the least loaded, and nothing is kept.
  std::size_t place(const std::shared_ptr<const Scene>& scene, const std::vector<Lane>& lanes);
  // Whether it is placed on that device now.
  bool is_at(const std::shared_ptr<const Scene>& scene, std::size_t device) const;
  std::uint64_t moved() const;

 private:
  std::size_t least_loaded(const std::vector<Lane>&) const;
  mutable std::mutex mutex_;
  struct Place {
    std::size_t lane = 0, device = 0;
  };
  std::map<std::weak_ptr<const Scene>, Place, std::owner_less<>> placed_;
  std::uint64_t moved_ = 0;
};

}  // namespace teletact::service
