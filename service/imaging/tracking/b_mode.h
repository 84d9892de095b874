// B-mode image of a frame (T2.9): the envelope of its RF, compressed by its logarithm, on kernels/b_mode.cl.
#pragma once

#include <array>
#include <vector>

#include "service/device/device.h"
#include "service/imaging/tracking/frame.h"

namespace teletact::service {

// (cosine, sine) of a packet of the centre frequency, two periods long under a Hann window; at most about 16
// taps a period, every `step`-th sample. Silent at 0 Hz and beyond twice the centre frequency, -6 dB half of
// it to both sides.
struct QuadratureTaps {
  std::vector<std::array<float, 2>> taps;  // of offsets (t - half) * step
  int half = 0, step = 1;
};
QuadratureTaps quadrature_taps(const AcquisitionGeometry&);

class BModeImager {
 public:
  explicit BModeImager(Queue);
  // A frame and a geometry as validate() accepts them.
  BMode image(const RfFrame&, const AcquisitionGeometry&);

 private:
  Queue queue_;
  Kernel power_, rows_;
};

}  // namespace teletact::service
