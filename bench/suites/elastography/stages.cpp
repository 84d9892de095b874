// The time of the imaging plane while a finger is answered beside it.
#include "bench/peers/contact_case.h"
#include "bench/suites/elastography/elastography.h"
#include "service/imaging/estimate.h"

namespace teletact::bench {

StageFigures measure_stages(const std::shared_ptr<service::Device>& device, bool quick) {
  PhantomCase c;
  c.tissue_width_m = 0.160;
  const Phantom p = Phantoms().make(c, 1);
  service::Elastography elastography(device);
  elastography.warm();
  const int windows = quick ? 5 : 31;
  const auto with = [&](service::ModulusKind kind) {
    return windows_beside_touch(
        {[&] {
          return elastography.estimate(
              p.pre, p.post, {p.geometry, {{p.sensed_force_n, p.contact_area_m2}}, p.tissue, {}, {kind, {}}});
        }},
        windows, make_tissue({}));
  };
  return {with(service::ModulusKind::kDirect), with(service::ModulusKind::kIterative)};
}

}  // namespace teletact::bench
