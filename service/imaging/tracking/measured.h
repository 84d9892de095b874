// A measured pair of frames on the host, downloaded once and read by everything that comes after; and whether
// the pair could be tracked, and how well.
#pragma once

#include <cstdint>
#include <optional>
#include <stdexcept>
#include <string>
#include <vector>

#include "service/device/device.h"
#include "service/imaging/tracking/displacement.h"
#include "service/imaging/tracking/frame.h"

namespace teletact::service {

// Strain tensor from displacement by least squares over a stated kernel (T2.4), kernels/strain.cl.
struct StrainOptions {
  double kernel_axial_m = 2.5e-3,
         kernel_lateral_m = 2.0e-3;  // whole lengths, rounded to odd numbers of nodes
  double residual_limit_m = 6e-6;    // rms of the axial displacement about the plane
};

// On the device, index i + nx j.
struct StrainEstimate {
  Array<float> tensor;  // 4 per node: eps_xx, eps_yy, eps_xy, rms residual (m); NaN where not determined
  Array<std::uint8_t> trusted;  // displacement trusted, enough of the kernel too, residual within its limit
  // 4 per node: standard deviations of eps_xx, eps_yy, eps_xy, from those of the displacement, how its errors
  // hang together between nodes, and the kernel's own bias; that of eps_yy without the bias. NaN where the
  // displacement came without any.
  Array<float> std = {};
};

class StrainEstimator {
 public:
  StrainEstimator(Queue, StrainOptions);
  StrainEstimate estimate(const DisplacementEstimate&, const ImageGrid&);
  const StrainOptions& options() const { return options_; }

 private:
  void propagate(const DisplacementEstimate&, const ImageGrid&, int half_columns, int half_rows,
                 StrainEstimate&);
  Queue queue_;
  StrainOptions options_;
  Kernel kernel_, rest_, deviation_;
};

// The pair cannot be tracked; what() says why and what to do.
struct TrackingError : std::runtime_error {
  enum class Reason { kNoSignal, kDecorrelated, kBeyondSearch, kNoCompression };
  TrackingError(Reason why, const std::string& what) : std::runtime_error(what), reason(why) {}
  Reason reason;
};

// Every field has grid.size() values, index i + nx j.
struct Measured {
  ImageGrid grid;
  Field axial_displacement, lateral_displacement;          // m, in the frame named by the geometry
  Field axial_displacement_std, lateral_displacement_std;  // m, standard deviations
  Field correlation;                                       // of pre and motion-compensated post
  std::vector<std::uint8_t> displacement_valid;            // displacement trusted
  Field axial_strain, lateral_strain, shear_strain;        // tensor components; NaN where not determined
  Field axial_strain_std, lateral_strain_std,
      shear_strain_std;                    // standard deviations; NaN where the strain is
  Field axial_strain_noise;                // without the bias of the kernel, which a model of it shares
  std::vector<std::uint8_t> strain_valid;  // displacement and strain trusted
  double coupling_m = 0;                   // depth of the tissue's surface below it; 0: none was found
  double median_correlation = 0;           // of the textured nodes
  // The part of the nodes whose strain can be used, times 1 / (1 + (s / e)^2) with the medians over them of
  // the strain's noise s and magnitude e. 1: all tracked, strain far above its noise; one half:
  // strain as large as its noise, or half of the nodes lost. 0 without any usable node.
  double quality = 0;
};

// Fills what is of the displacement, and what is of the strain with the pair's quality; `grid` and
// `median_correlation` are the caller's.
void download(const Queue&, const DisplacementEstimate&, Measured&);
void download(const Queue&, const StrainEstimate&, Measured&);

// The probe at rest: whether the tissue rests at such a surface rather than at the probe's face, by its
// displacement below.
bool rests_below(double surface_m, const Measured&);

// Nothing is valid above, and the quality that of the rest.
void leave_out_above(double depth_m, Measured&);

// Over the nodes with texture (correlation as DisplacementEstimate has it). Throws TrackingError kNoSignal
// when fewer than a tenth of the nodes have any.
double median_correlation(const Field& correlation);

// - lateral over axial strain, of the medians over the nodes whose strain is trusted; empty without any.
std::optional<double> lateral_ratio(const Measured&);

}  // namespace teletact::service
