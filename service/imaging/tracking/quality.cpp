#include "service/imaging/tracking/quality.h"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <iterator>

#include "service/imaging/tracking/median.h"

namespace teletact::service {
namespace {

constexpr float kUntextured = -1.5f;  // correlations below mean that the window has no texture
constexpr double kMinTexturedFraction = 0.1;

}  // namespace

double median_correlation(const Field& correlation) {
  std::vector<float> textured;
  std::copy_if(correlation.begin(), correlation.end(), std::back_inserter(textured),
               [](float c) { return c > kUntextured; });
  if (textured.empty() ||
      static_cast<double>(textured.size()) < kMinTexturedFraction * static_cast<double>(correlation.size()))
    throw TrackingError(TrackingError::Reason::kNoSignal,
                        "pre, post: " + std::to_string(textured.size()) + " of " +
                            std::to_string(correlation.size()) +
                            " nodes show any echo; check the gain and the probe's contact");
  return median(textured);
}

double pair_quality(const Field& axial_strain, const Field& axial_strain_std,
                    const std::vector<std::uint8_t>& strain_valid) {
  std::vector<float> magnitude, deviation;
  for (std::size_t n = 0; n < strain_valid.size(); ++n) {
    if (!strain_valid[n] || !std::isfinite(axial_strain_std[n])) continue;
    magnitude.push_back(std::abs(axial_strain[n]));
    deviation.push_back(axial_strain_std[n]);
  }
  if (magnitude.empty()) return 0;
  const double e = median(magnitude), s = median(deviation), power = e * e + s * s;
  const double usable = static_cast<double>(magnitude.size()) / static_cast<double>(strain_valid.size());
  return power > 0 ? usable * e * e / power : 0;
}

}  // namespace teletact::service
