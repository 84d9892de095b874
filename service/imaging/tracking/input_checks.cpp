#include "service/imaging/tracking/input_checks.h"

#include <fmt/format.h>

#include <Eigen/Core>
#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>
#include <vector>

#include "service/imaging/tracking/median.h"

namespace teletact::service {
namespace {

constexpr double kFrequencyRatio = 1.5;
constexpr std::size_t kLinesLookedAt = 16;
constexpr double kUsuallyLoud = 0.75;  // part of the pieces; what is louder counts as much as those do
constexpr double kMinMotionM = 5e-6;   // of one side over the other: well above what tracking is off by

constexpr std::size_t kPiece = 128, kPieces = 256, kReach = 24;  // of lines, for what oscillates
// The least of an autocorrelation over its value at 0: echoes have -0.6, an envelope and what lies across
// lines -0.1.
constexpr double kNoDip = -0.2, kDip = -0.35;
constexpr double kSmooth = 0.5;  // autocorrelation of neighbours from which on samples are no noise

struct Autocorrelation {
  double next = 0, least = 0;  // at a lag of 1; up to kReach
};

// Along depth, or across the lines; of pieces without their means.
Autocorrelation autocorrelation(const RfFrame& frame, bool along_depth) {
  const std::size_t length = along_depth ? frame.sample_count : frame.line_count,
                    lines = along_depth ? frame.line_count : frame.sample_count,
                    step = along_depth ? 1 : frame.sample_count,
                    stride = along_depth ? frame.sample_count : 1, piece = std::min(kPiece, length),
                    in_line = length / piece, every = std::max<std::size_t>(1, lines * in_line / kPieces);
  // Each piece counts alike, however loud.
  std::vector<double> r(std::min(kReach, piece / 2) + 1);
  Eigen::VectorXd part(piece);
  for (std::size_t l = 0; l < lines; l += every)
    for (std::size_t p = 0; p < in_line; ++p) {
      for (std::size_t k = 0; k < piece; ++k)
        part[static_cast<Eigen::Index>(k)] = frame.samples[l * stride + (p * piece + k) * step];
      part.array() -= part.mean();
      const double own = part.squaredNorm();
      for (std::size_t lag = 0; own > 0 && lag < r.size(); ++lag) {
        const auto both = static_cast<Eigen::Index>(piece - lag);
        r[lag] += part.head(both).dot(part.tail(both)) / own;
      }
    }
  if (!(r[0] > 0)) return {};
  return {r[1] / r[0], *std::ranges::min_element(r) / r[0]};
}

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
  struct Lags {
    double own = 0, one = 0, two = 0;
  };
  std::vector<Lags> pieces;
  const std::size_t every = std::max<std::size_t>(frame.line_count / kLinesLookedAt, 1),
                    piece = std::min(kPiece, frame.sample_count);
  for (std::size_t l = 0; l < frame.line_count; l += every)
    for (std::size_t first = 0; first + piece <= frame.sample_count; first += piece) {
      const float* at = frame.samples.data() + l * frame.sample_count + first;
      double mean = 0;
      for (std::size_t k = 0; k < piece; ++k) mean += at[k];
      mean /= static_cast<double>(piece);
      Lags lags;
      for (std::size_t k = 2; k < piece; ++k) {
        lags.own += (at[k] - mean) * (at[k] - mean);
        lags.one += (at[k] - mean) * (at[k - 1] - mean);
        lags.two += (at[k] - mean) * (at[k - 2] - mean);
      }
      if (lags.own > 0) pieces.push_back(lags);
    }
  if (pieces.empty()) return std::numeric_limits<double>::quiet_NaN();
  // Few loud echoes must not decide: with them a crop may have another frequency than the whole.
  const auto loud =
      pieces.begin() + static_cast<std::ptrdiff_t>(kUsuallyLoud * static_cast<double>(pieces.size() - 1));
  std::ranges::nth_element(pieces, loud, {}, &Lags::own);
  const double most = loud->own;
  double r1 = 0, r2 = 0;
  for (const Lags& lags : pieces) {
    const double share = std::min(1.0, most / lags.own);
    r1 += share * lags.one, r2 += share * lags.two;
  }
  if (r1 == 0) return std::numeric_limits<double>::quiet_NaN();
  const double ratio = r2 / r1;  // (2 c^2 - 1) / c with c = cos w, of the sign of r1
  const double c = (ratio + std::copysign(std::sqrt(ratio * ratio + 8), r1)) / 4;
  return std::acos(std::clamp(c, -1.0, 1.0)) / (2 * std::numbers::pi) * sampling_frequency_hz;
}

std::optional<Warning> contradicted_rf(const RfFrame& pre) {
  const Autocorrelation depth = autocorrelation(pre, true);
  if (depth.least < kNoDip) return std::nullopt;
  if (autocorrelation(pre, false).least < kDip)
    return Warning{WarningFlag::kAxis,
                   "the samples do not oscillate along depth but across the lines: the two dimensions are "
                   "exchanged; send line after line, depth fastest"};
  if (depth.next > kSmooth)
    return Warning{WarningFlag::kImage,
                   "the samples do not oscillate along depth, like those of an envelope or a B-mode image; "
                   "send RF, with the phase of its echoes"};
  return std::nullopt;
}

std::optional<Warning> contradicted_frequency(const RfFrame& pre, const AcquisitionGeometry& geometry) {
  const double found = mean_frequency(pre, geometry.sampling_frequency_hz);
  const double ratio = found / geometry.center_frequency_hz;
  if (!(ratio > kFrequencyRatio || ratio < 1 / kFrequencyRatio)) return std::nullopt;
  return Warning{
      WarningFlag::kCenterFrequency,
      fmt::format("{:.1f} MHz is stated, but the frames are around {:.1f} MHz if sampling_frequency_hz is "
                  "{:.1f} MHz: "
                  "one of the two is wrong, and with the latter every length",
                  geometry.center_frequency_hz * 1e-6, found * 1e-6, geometry.sampling_frequency_hz * 1e-6)};
}

std::optional<Warning> contradicted_frame(const AcquisitionGeometry& geometry, const ImageGrid& grid,
                                          const Field& axial_displacement,
                                          const std::vector<std::uint8_t>& trusted) {
  const auto top = motion(grid, axial_displacement, trusted, false),
             bottom = motion(grid, axial_displacement, trusted, true);
  if (!top || !bottom) return std::nullopt;
  if (geometry.frame == DisplacementFrame::kLab && *bottom > *top + kMinMotionM)
    return Warning{
        WarningFlag::kDisplacementFrame,
        "LAB is stated, where the far side rests, but it moves more than the probe's side: PROBE?"};
  if (geometry.frame == DisplacementFrame::kProbe && *top > *bottom + kMinMotionM)
    return Warning{
        WarningFlag::kDisplacementFrame,
        "PROBE is stated, where the probe's side rests, but it moves more than the far side: LAB?"};
  return std::nullopt;
}

}  // namespace teletact::service
