// Strain tensor from displacement by least squares over a stated kernel (T2.4), kernels/strain.cl.
#pragma once

#include "service/device/device.h"
#include "service/imaging/tracking/displacement.h"
#include "service/imaging/tracking/frame.h"

namespace teletact::service {

struct StrainOptions {
  double kernel_axial_m = 2.5e-3,
         kernel_lateral_m = 2.0e-3;  // whole lengths, rounded to odd numbers of nodes
  double residual_limit_m = 6e-6;    // rms of the axial displacement about the plane
};

// On the device, index i + nx j.
struct StrainEstimate {
  Array<float> tensor;  // 4 per node: eps_xx, eps_yy, eps_xy, rms residual (m); NaN where not determined
  Array<std::uint8_t> trusted;  // displacement trusted, enough of the kernel too, residual within its limit
  // 3 per node: standard deviations of eps_xx, eps_yy, eps_xy, from those of the displacement and how its
  // errors hang together between nodes. NaN where the displacement came without any.
  Array<float> std = {};
};

class StrainEstimator {
 public:
  StrainEstimator(Queue, StrainOptions);
  StrainEstimate estimate(const DisplacementEstimate&, const ImageGrid&);

 private:
  void propagate(const DisplacementEstimate&, const ImageGrid&, int half_columns, int half_rows,
                 StrainEstimate&);
  Queue queue_;
  StrainOptions options_;
  Kernel kernel_, deviation_;
};

}  // namespace teletact::service
