#include "service/imaging/tracking/input_checks.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>

#include "service/imaging/tracking/median.h"

namespace teletact::service {
namespace {

constexpr double kFrequencyRatio = 1.5;
constexpr std::size_t kLinesLookedAt = 16;
constexpr double kMinMotionM = 5e-6;  // of one side over the other: well above what tracking is off by

// Median magnitude over the trusted nodes of the first (or last) tenth of the rows that have any.
std::optional<double> motion(const ImageGrid& grid, const Field& axial,
                             const std::vector<std::uint8_t>& trusted, bool last) {
  std::vector<float> magnitudes;
  std::size_t rows = 0;
  for (std::size_t k = 0; k < grid.ny && rows < std::max<std::size_t>(grid.ny / 10, 1); ++k) {
    const std::size_t j = last ? grid.ny - 1 - k : k, before = magnitudes.size();
    for (std::size_t n = j * grid.nx; n < (j + 1) * grid.nx; ++n)
      if (trusted[n]) magnitudes.push_back(std::abs(axial[n]));
    rows += magnitudes.size() > before;
  }
  if (magnitudes.empty()) return std::nullopt;
  return median(magnitudes);
}

}  // namespace

double mean_frequency(const RfFrame& frame, double sampling_frequency_hz) {
  double r1 = 0, r2 = 0;
  const std::size_t every = std::max<std::size_t>(frame.line_count / kLinesLookedAt, 1);
  for (std::size_t l = 0; l < frame.line_count; l += every) {
    const float* line = frame.samples.data() + l * frame.sample_count;
    double mean = 0;
    for (std::size_t k = 0; k < frame.sample_count; ++k) mean += line[k];
    mean /= static_cast<double>(frame.sample_count);
    for (std::size_t k = 2; k < frame.sample_count; ++k) {
      r1 += (line[k] - mean) * (line[k - 1] - mean);
      r2 += (line[k] - mean) * (line[k - 2] - mean);
    }
  }
  if (r1 == 0) return std::numeric_limits<double>::quiet_NaN();
  const double ratio = r2 / r1;  // (2 c^2 - 1) / c with c = cos w, of the sign of r1
  const double c = (ratio + std::copysign(std::sqrt(ratio * ratio + 8), r1)) / 4;
  return std::acos(std::clamp(c, -1.0, 1.0)) / (2 * std::numbers::pi) * sampling_frequency_hz;
}

std::optional<std::string> contradicted_frequency(const RfFrame& pre, const AcquisitionGeometry& geometry) {
  const double found = mean_frequency(pre, geometry.sampling_frequency_hz);
  const double ratio = found / geometry.center_frequency_hz;
  if (!(ratio > kFrequencyRatio || ratio < 1 / kFrequencyRatio)) return std::nullopt;
  return fmt::format(
      "center_frequency_hz: {:.1f} MHz is stated, but the frames are around {:.1f} MHz if "
      "sampling_frequency_hz is {:.1f} MHz: one of the two is wrong, and with the latter every length",
      geometry.center_frequency_hz * 1e-6, found * 1e-6, geometry.sampling_frequency_hz * 1e-6);
}

std::optional<std::string> contradicted_frame(const AcquisitionGeometry& geometry, const ImageGrid& grid,
                                              const Field& axial_displacement,
                                              const std::vector<std::uint8_t>& trusted) {
  const auto top = motion(grid, axial_displacement, trusted, false),
             bottom = motion(grid, axial_displacement, trusted, true);
  if (!top || !bottom) return std::nullopt;
  if (geometry.frame == DisplacementFrame::kLab && *bottom > *top + kMinMotionM)
    return "displacement_frame: LAB is stated, where the far side rests, but it moves more than the probe's "
           "side: PROBE?";
  if (geometry.frame == DisplacementFrame::kProbe && *top > *bottom + kMinMotionM)
    return "displacement_frame: PROBE is stated, where the probe's side rests, but it moves more than the "
           "far side: LAB?";
  return std::nullopt;
}

}  // namespace teletact::service
