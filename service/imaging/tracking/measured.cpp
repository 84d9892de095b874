#include "service/imaging/tracking/measured.h"

#include <cstddef>

#include "service/imaging/tracking/quality.h"

namespace teletact::service {
namespace {

// Component c of `stride` interleaved ones.
Field component(const std::vector<float>& interleaved, std::size_t stride, std::size_t c) {
  Field field(interleaved.size() / stride);
  for (std::size_t n = 0; n < field.size(); ++n) field[n] = interleaved[stride * n + c];
  return field;
}

}  // namespace

void download(const Queue& queue, const DisplacementEstimate& displacement, Measured& out) {
  const std::vector<float> field = queue.read(displacement.field_m), std_m = queue.read(displacement.std_m);
  out.lateral_displacement = component(field, 2, 0);
  out.axial_displacement = component(field, 2, 1);
  out.lateral_displacement_std = component(std_m, 2, 0);
  out.axial_displacement_std = component(std_m, 2, 1);
  out.correlation.resize(out.grid.size());
  queue.read(displacement.correlation, out.correlation.data(), out.correlation.size());
  out.displacement_valid = queue.read(displacement.trusted);
}

void download(const Queue& queue, const StrainEstimate& strain, Measured& out) {
  const std::vector<float> tensor = queue.read(strain.tensor), std = queue.read(strain.std);
  out.lateral_strain = component(tensor, 4, 0);
  out.axial_strain = component(tensor, 4, 1);
  out.shear_strain = component(tensor, 4, 2);
  out.lateral_strain_std = component(std, 3, 0);
  out.axial_strain_std = component(std, 3, 1);
  out.shear_strain_std = component(std, 3, 2);
  out.strain_valid = queue.read(strain.trusted);
  out.quality = pair_quality(out.axial_strain, out.axial_strain_std, out.strain_valid);
}

}  // namespace teletact::service
