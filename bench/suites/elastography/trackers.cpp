#include <cmath>

#include "bench/suites/elastography/elastography.h"
#include "service/imaging/tracking/displacement.h"

namespace teletact::bench {
namespace {

class OurTracker : public Tracker {
 public:
  OurTracker(service::Queue queue, const service::DisplacementOptions& options)
      : queue_(std::move(queue)), estimator_(queue_, options) {}
  std::string name() const override { return "ours"; }
  bool ours() const override { return true; }
  Track track(const service::RfFrame& pre, const service::RfFrame& post,
              const service::AcquisitionGeometry& geometry) override {
    const service::DisplacementEstimate e = estimator_.estimate(pre, post, geometry);
    const std::vector<float> field = queue_.read(e.field_m);
    Track t;
    t.grid = service::image_grid(e.grid, geometry);
    for (std::size_t n = 0; n < t.grid.size(); ++n) {
      t.lateral_m.push_back(field[2 * n]);
      t.axial_m.push_back(field[2 * n + 1]);
    }
    t.valid = queue_.read(e.trusted);
    t.valid.resize(t.grid.size());
    const std::vector<float> std_m = queue_.read(e.std_m);
    for (std::size_t n = 0; n < t.grid.size(); ++n) t.std_m.push_back(std_m[2 * n + 1]);
    return t;
  }

 private:
  service::Queue queue_;
  service::DisplacementEstimator estimator_;
};

}  // namespace

std::vector<std::unique_ptr<Tracker>> make_trackers(const std::shared_ptr<service::Device>& device,
                                                    double max_strain) {
  std::vector<std::unique_ptr<Tracker>> all;
  service::DisplacementOptions ours;
  ours.max_strain = max_strain;
  TrackerOptions theirs;
  theirs.max_strain = max_strain;
  all.push_back(std::make_unique<OurTracker>(device->queue(), ours));
  all.push_back(make_ncc_tracker(theirs));
  all.push_back(make_block_matcher(theirs));
  all.push_back(make_glue_tracker(theirs));
  all.push_back(make_loupas_tracker(theirs));
  return all;
}

}  // namespace teletact::bench
