#include "client/acquire/rf_checks.h"

#include <fmt/format.h>

#include <algorithm>
#include <bit>
#include <cmath>
#include <complex>
#include <numbers>
#include <optional>
#include <utility>

#include "client/acquire/recorded_frames.h"

namespace teletact::client {
namespace {

// Density of the spectrum at its low end over that at its peak: echoes have 0.004 at most (a phantom, three
// simulations), envelopes, pictures and what lies across lines 0.85 at least.
constexpr double kOscillates = 0.25, kDoesNot = 0.5;
constexpr double kMinPeriods = 16;  // of a piece: its low end is far below the peak
constexpr std::size_t kMinPiece = 32, kMaxPiece = 1024, kMaxPieces = 256;
constexpr double kOffset = 0.2;        // of the samples' root mean square about their mean
constexpr double kHigher = 1.15;       // tissue lowers the frequency of echoes, nothing raises it
constexpr double kLower = 0.84;        // it takes a tenth, seldom more than a sixth
constexpr double kServiceSays = 1.6;   // from this ratio on, in either direction: it begins at 1.5
constexpr double kUsuallyLoud = 0.75;  // part of the pieces; what is louder counts as much as those do
constexpr double kAlike = 0.01;
constexpr double kAreasApart = 1.5;

// Equal places along one dimension of a plane of samples.
struct Lines {
  const float* samples;
  std::size_t count, length, between_lines, between_samples;
};

std::size_t piece_of(double period) {
  const double least = std::fmin(kMinPeriods * period, static_cast<double>(kMaxPiece));
  return std::max(kMinPiece, std::bit_ceil(static_cast<std::size_t>(std::ceil(least))));
}

// Density of the mean spectrum of pieces of the lines at k / piece, k = 0 to piece / 2; without the pieces'
// means, and so that few loud echoes do not decide: with them a crop may have another than the whole. Empty
// where the lines are too short, or silent.
std::vector<double> spectrum(const Lines& lines, double period) {
  const std::size_t piece = piece_of(period);
  if (lines.length < piece || lines.count == 0) return {};
  std::vector<std::complex<double>> turn(piece);
  std::vector<double> window(piece), part(piece), sum(piece / 2 + 1), powers;
  std::vector<std::vector<double>> densities;
  for (std::size_t k = 0; k < piece; ++k) {
    turn[k] = std::polar(1.0, -2 * std::numbers::pi * static_cast<double>(k) / static_cast<double>(piece));
    window[k] = 1 - turn[k].real();
  }
  const std::size_t in_line = lines.length / piece,
                    every = std::max<std::size_t>(1, in_line * lines.count / kMaxPieces);
  // Of whole lines: at one end they may be silent.
  for (std::size_t p = 0; p < (lines.count + every - 1) / every * in_line; ++p) {
    const float* at = lines.samples + p / in_line * every * lines.between_lines +
                      p % in_line * piece * lines.between_samples;
    double mean = 0;
    for (std::size_t k = 0; k < piece; ++k) mean += at[k * lines.between_samples];
    mean /= static_cast<double>(piece);
    for (std::size_t k = 0; k < piece; ++k) part[k] = window[k] * (at[k * lines.between_samples] - mean);
    std::vector<double> density(sum.size());
    double power = 0;
    for (std::size_t f = 0; f < density.size(); ++f) {
      std::complex<double> value{};
      for (std::size_t k = 0; k < piece; ++k) value += part[k] * turn[f * k % piece];
      power += density[f] = std::norm(value);
    }
    if (!(power > 0)) continue;
    powers.push_back(power), densities.push_back(std::move(density));
  }
  if (densities.empty()) return {};
  std::vector<double> sorted = powers;
  const auto loud =
      sorted.begin() + static_cast<std::ptrdiff_t>(kUsuallyLoud * static_cast<double>(sorted.size() - 1));
  std::nth_element(sorted.begin(), loud, sorted.end());
  for (std::size_t p = 0; p < densities.size(); ++p)
    for (std::size_t f = 0; f < sum.size(); ++f) sum[f] += std::min(1.0, *loud / powers[p]) * densities[p][f];
  return sum;
}

// Absent: the samples do not tell.
std::optional<bool> oscillates(const Lines& lines, double period) {
  const std::vector<double> density = spectrum(lines, period);
  if (density.empty()) return std::nullopt;
  const double low = (density[1] + density[2]) / 2,
               peak = *std::max_element(density.begin() + 1, density.end());
  if (low < kOscillates * peak) return true;
  if (low > kDoesNot * peak) return false;
  return std::nullopt;
}

// The middle of what stands out, in oscillations per sample; absent where nothing does.
std::optional<double> middle(const Lines& lines, double period) {
  const std::vector<double> density = spectrum(lines, period);
  if (density.empty()) return std::nullopt;
  const double least = *std::max_element(density.begin() + 1, density.end()) / 4;
  double sum = 0, all = 0;
  for (std::size_t f = 2; f < density.size(); ++f) {
    if (density[f] < least) continue;
    sum += density[f] * static_cast<double>(f), all += density[f];
  }
  if (all == 0) return std::nullopt;
  return sum / all / static_cast<double>(2 * (density.size() - 1));
}

Lines along_depth(const std::vector<float>& samples, std::size_t line_count) {
  const std::size_t length = samples.size() / line_count;
  return {samples.data(), line_count, length, length, 1};
}

// Whether there was one.
bool remove_offset(std::vector<float>& samples) {
  double sum = 0, squares = 0;
  for (const float v : samples) sum += v;
  const double mean = sum / static_cast<double>(samples.size());
  for (const float v : samples) squares += (v - mean) * (v - mean);
  if (std::abs(mean) <= kOffset * std::sqrt(squares / static_cast<double>(samples.size()))) return false;
  for (float& v : samples) v = static_cast<float>(v - mean);
  return true;
}

std::string in_mhz(double hz) {
  return fmt::format("{:.1f} MHz", hz * 1e-6);
}

}  // namespace

RfAxis rf_axis(const std::vector<float>& samples, std::size_t fast, double period) {
  const std::size_t slow = samples.size() / fast;
  const auto first = oscillates({samples.data(), slow, fast, fast, 1}, period),
             second = oscillates({samples.data(), fast, slow, 1, fast}, period);
  if (first == true) return RfAxis::kFastest;
  // Fewer lines than tell anything are lines all the same if the other dimension oscillates.
  if ((first == false || fast < piece_of(period)) && second == true) return RfAxis::kSlowest;
  return first == false ? RfAxis::kNeither : RfAxis::kUnclear;
}

std::vector<float> turned(const std::vector<float>& samples, std::size_t fast) {
  const std::size_t slow = samples.size() / fast;
  std::vector<float> out(samples.size());
  for (std::size_t s = 0; s < slow; ++s)
    for (std::size_t f = 0; f < fast; ++f) out[s + slow * f] = samples[f + fast * s];
  return out;
}

RfVerdict check_rf(std::vector<float>& samples, std::size_t line_count, RfAxis axis,
                   const RfStatement& said) {
  if (!std::all_of(samples.begin(), samples.end(), [](float v) { return std::isfinite(v); }))
    throw FrameInputError(said.file + ": holds NaN or infinity; replace or crop them");
  if (!(said.sampling_frequency_hz > 2 * said.center_frequency_hz))
    throw FrameInputError(fmt::format(
        "{}: its samples are {:.6g} Hz, and more than twice the centre frequency is needed; give RF of 5 "
        "samples or more in a period",
        said.file, said.sampling_frequency_hz));
  if (axis == RfAxis::kNeither || (axis == RfAxis::kUnclear && !said.kind.empty()))
    throw FrameInputError(fmt::format(
        "{}: holds an envelope or an image, or IQ{}, without the phase of the echoes: its samples do not "
        "oscillate along depth; give RF, or in a .uff file the complex data that the beamformer made",
        said.file, said.kind.empty() ? "" : " (" + said.kind + ")"));
  RfVerdict verdict;
  const double found = middle(along_depth(samples, line_count),
                              said.sampling_frequency_hz / said.center_frequency_hz)
                           .value_or(0),
               hz = found * said.sampling_frequency_hz, ratio = hz / said.center_frequency_hz;
  if (!said.kind.empty())
    verdict.doubts.push_back(
        fmt::format("{}: says {}, but its samples oscillate as RF does, around {}: taken as RF", said.file,
                    said.kind, in_mhz(hz)));
  if (hz > 0 && (ratio > kHigher || ratio < kLower) && ratio < kServiceSays && ratio > 1 / kServiceSays)
    verdict.doubts.push_back(
        fmt::format("{}: its echoes lie around {}, {} the {} stated, {}. If the sampling frequency is not "
                    "{}, every length is wrong",
                    said.file, in_mhz(hz), ratio > 1 ? "above" : "below", in_mhz(said.center_frequency_hz),
                    ratio > 1 ? "which tissue cannot cause" : "as some scanners' do",
                    in_mhz(said.sampling_frequency_hz)));
  verdict.had_offset = remove_offset(samples);
  return verdict;
}

std::vector<std::string> doubtful_lengths(const RfLengths& lengths) {
  std::vector<std::string> doubts;
  if (std::abs(lengths.line_pitch_m - lengths.sample_pitch_m) <= kAlike * lengths.sample_pitch_m)
    doubts.push_back(fmt::format(
        "{}: A-lines {:.4g} mm apart, exactly as the samples along depth: is that the distance of lines? If "
        "not, every width and the modulus are wrong",
        lengths.file, 1e3 * lengths.line_pitch_m));
  if (lengths.contact_area_m2 > 0 && lengths.probe_elevation_m > 0) {
    const double area = lengths.probe_elevation_m * lengths.width_m, ratio = lengths.contact_area_m2 / area;
    if (ratio > kAreasApart || ratio < 1 / kAreasApart)
      doubts.push_back(fmt::format(
          "--contact-area-m2 {:.3g} is {:.2g} times --probe-elevation-m {:.3g} times the frame's width "
          "{:.3g} m: a solid's modulus goes with the elevation, not with the area; correct one of them",
          lengths.contact_area_m2, ratio, lengths.probe_elevation_m, lengths.width_m));
  }
  return doubts;
}

}  // namespace teletact::client
