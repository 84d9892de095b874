// The time of the imaging plane while a finger is answered beside it.
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
  return {windows_beside_touch(elastography, service::ModulusKind::kDirect, p, windows),
          windows_beside_touch(elastography, service::ModulusKind::kIterative, p, windows)};
}

}  // namespace teletact::bench
