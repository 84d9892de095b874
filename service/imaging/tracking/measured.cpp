#include "service/imaging/tracking/measured.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <initializer_list>
#include <iterator>

#include "service/imaging/tracking/median.h"

namespace teletact::service {
namespace {

constexpr float kUntextured = -1.5f;  // correlations below mean that the window has no texture
constexpr double kMinTexturedFraction = 0.1;

// Takes interleaved components apart: the first of every node to the first field, and so on.
void split(const std::vector<float>& interleaved, std::size_t components, std::initializer_list<Field*> to) {
  std::size_t c = 0;
  for (Field* field : to) {
    field->resize(interleaved.size() / components);
    for (std::size_t n = 0; n < field->size(); ++n) (*field)[n] = interleaved[components * n + c];
    ++c;
  }
}

double pair_quality(const Measured& m) {
  std::vector<float> magnitude, deviation;
  for (std::size_t n = 0; n < m.strain_valid.size(); ++n) {
    if (!m.strain_valid[n] || !std::isfinite(m.axial_strain_std[n])) continue;
    magnitude.push_back(std::abs(m.axial_strain[n]));
    deviation.push_back(m.axial_strain_std[n]);
  }
  if (magnitude.empty()) return 0;
  const double e = median(magnitude), s = median(deviation), power = e * e + s * s;
  const double usable = static_cast<double>(magnitude.size()) / static_cast<double>(m.strain_valid.size());
  return power > 0 ? usable * e * e / power : 0;
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
  out.quality = pair_quality(out);
}

double median_correlation(const Field& correlation) {
  std::vector<float> textured;
  std::copy_if(correlation.begin(), correlation.end(), std::back_inserter(textured),
               [](float c) { return c > kUntextured; });
  if (textured.empty() ||
      static_cast<double>(textured.size()) < kMinTexturedFraction * static_cast<double>(correlation.size()))
    throw TrackingError(
        TrackingError::Reason::kNoSignal,
        fmt::format("pre, post: {} of {} nodes show any echo; check the gain and the probe's contact",
                    textured.size(), correlation.size()));
  return median(textured);
}

std::optional<double> lateral_ratio(const Measured& m) {
  std::vector<float> lateral, axial;
  for (std::size_t n = 0; n < m.grid.size(); ++n)
    if (m.strain_valid[n]) lateral.push_back(m.lateral_strain[n]), axial.push_back(m.axial_strain[n]);
  if (axial.empty()) return std::nullopt;
  return -median(lateral) / median(axial);
}

}  // namespace teletact::service
