#include "service/imaging/tracking/measured.h"

#include <cstddef>
#include <initializer_list>

#include "service/imaging/tracking/quality.h"

namespace teletact::service {
namespace {

// Takes interleaved components apart: the first of every node to the first field, and so on.
void split(const std::vector<float>& interleaved, std::size_t components, std::initializer_list<Field*> to) {
  std::size_t c = 0;
  for (Field* field : to) {
    field->resize(interleaved.size() / components);
    for (std::size_t n = 0; n < field->size(); ++n) (*field)[n] = interleaved[components * n + c];
    ++c;
  }
}

}  // namespace

void download(const Queue& queue, const DisplacementEstimate& displacement, Measured& out) {
  split(queue.read(displacement.field_m), 2, {&out.lateral_displacement, &out.axial_displacement});
  split(queue.read(displacement.std_m), 2, {&out.lateral_displacement_std, &out.axial_displacement_std});
  out.correlation.resize(out.grid.size());
  queue.read(displacement.correlation, out.correlation.data(), out.correlation.size());
  out.displacement_valid = queue.read(displacement.trusted);
}

void download(const Queue& queue, const StrainEstimate& strain, Measured& out) {
  split(queue.read(strain.tensor), 4, {&out.lateral_strain, &out.axial_strain, &out.shear_strain});
  split(queue.read(strain.std), 3, {&out.lateral_strain_std, &out.axial_strain_std, &out.shear_strain_std});
  out.strain_valid = queue.read(strain.trusted);
  out.quality = pair_quality(out.axial_strain, out.axial_strain_std, out.strain_valid);
}

}  // namespace teletact::service
