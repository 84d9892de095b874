#include "bench/suites/elastography/elastography.h"
#include "service/imaging/tracking/displacement.h"

namespace teletact::bench {
namespace {

Tracker ours(const std::shared_ptr<service::Device>& device, double max_strain) {
  service::DisplacementOptions options;
  options.max_strain = max_strain;
  const service::Queue queue = device->queue();
  const auto estimator = std::make_shared<service::DisplacementEstimator>(queue, options);
  const auto track = [queue, estimator](const service::RfFrame& pre, const service::RfFrame& post,
                                        const service::AcquisitionGeometry& geometry) {
    const service::DisplacementEstimate e = estimator->estimate(pre, post, geometry);
    const std::vector<float> field = queue.read(e.field_m), std_m = queue.read(e.std_m);
    Track t;
    t.grid = service::image_grid(e.grid, geometry);
    for (std::size_t n = 0; n < t.grid.size(); ++n) {
      t.lateral_m.push_back(field[2 * n]);
      t.axial_m.push_back(field[2 * n + 1]);
      t.std_m.push_back(std_m[2 * n + 1]);
    }
    t.valid = queue.read(e.trusted);
    t.valid.resize(t.grid.size());
    return t;
  };
  return {"ours", track, true};
}

std::vector<Tracker> searching(const std::shared_ptr<service::Device>& device, double max_strain) {
  TrackerOptions theirs;
  theirs.max_strain = max_strain;
  return {ours(device, max_strain), make_ncc_tracker(theirs), make_block_matcher(theirs),
          make_glue_tracker(theirs), make_loupas_tracker(theirs)};
}

}  // namespace

Trackers make_trackers(const std::shared_ptr<service::Device>& device) {
  return {searching(device, TrackerOptions{}.max_strain), searching(device, kWideStrain)};
}

double max_strain_of(const PhantomCase& c, bool ours) {
  const double usual = TrackerOptions{}.max_strain;
  return (ours ? c.strain > usual : c.strain >= usual) ? kWideStrain : usual;
}

const Tracker& Trackers::of(std::size_t method, const PhantomCase& c) const {
  return (max_strain_of(c, usual[method].ours) == kWideStrain ? wide : usual)[method];
}

}  // namespace teletact::bench
