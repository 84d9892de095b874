#include "client/patient/rf.h"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <random>

namespace teletact::client {

namespace {

// Reach of the truncated PSF in standard deviations: e^-8 of the peak.
constexpr double kReach = 4;
constexpr double kBeamReach = 2.5;    // the same across the image plane, where nothing is as sharp
constexpr std::size_t kPhases = 512;  // sub-sample positions of the tabulated pulse: 0.04 um at 40 MHz

using Random = std::mt19937_64;

double uniform(Random& random) {
  return static_cast<double>(random() >> 11) * 0x1p-53;
}

struct Psf {
  double axial_sigma_m = 0, lateral_sigma_m = 0;
  double cycles_per_m = 0;  // of the RF along depth: 2 f0 / c
};

const double kFwhmPerSigma = 2 * std::sqrt(2 * std::numbers::ln2);

// sigma_t = 1 / (2 pi sigma_f)
Psf psf_of(const Ultrasound& u, double depth_m = 0) {
  return {u.sound_speed_m_s / 2 / (2 * std::numbers::pi * spectrum_sigma_hz(u)),
          u.wavelength_m() * u.f_number / kFwhmPerSigma,
          2 * centre_frequency_hz(u, depth_m) / u.sound_speed_m_s};
}

// Of the beam's widths at a depth, over those at its focus.
double widening(const Ultrasound& u, double depth_m) {
  return std::sqrt(1 + std::pow(u.beam_growth * (depth_m / u.focus_m - 1), 2));
}

double pulse(const Psf& psf, double depth_m) {
  const double s = depth_m / psf.axial_sigma_m;
  return std::exp(-.5 * s * s) * std::cos(2 * std::numbers::pi * psf.cycles_per_m * depth_m);
}

// pulse(k - reach - phase) for a scatterer `phase` samples below a sample, at [phase * width + k].
struct PulseTable {
  PulseTable(const Psf& psf, double sample_pitch_m)
      : reach(static_cast<std::ptrdiff_t>(std::ceil(kReach * psf.axial_sigma_m / sample_pitch_m))),
        width(static_cast<std::size_t>(2 * reach + 2)),
        values(kPhases * width) {
    for (std::size_t p = 0; p < kPhases; ++p)
      for (std::size_t k = 0; k < width; ++k) {
        const double samples = static_cast<double>(k) - static_cast<double>(reach) -
                               (static_cast<double>(p) + .5) / static_cast<double>(kPhases);
        values[p * width + k] = static_cast<float>(pulse(psf, samples * sample_pitch_m));
      }
  }
  std::ptrdiff_t reach;
  std::size_t width;
  std::vector<float> values;
};

// Of the depths of an image; one for all where nothing is attenuated.
class Pulses {
 public:
  Pulses(const Ultrasound& u, double sample_pitch_m, double deepest_m) {
    const auto bands = u.attenuation_db_cm_mhz > 0 ? static_cast<std::size_t>(deepest_m / kBandM) + 1 : 1;
    for (std::size_t n = 0; n < bands; ++n)
      tables_.emplace_back(psf_of(u, bands > 1 ? kBandM * (static_cast<double>(n) + .5) : 0), sample_pitch_m);
  }
  const PulseTable& at(double depth_m) const {
    return tables_[std::min(tables_.size() - 1, static_cast<std::size_t>(depth_m / kBandM))];
  }

 private:
  static constexpr double kBandM = .001;
  std::vector<PulseTable> tables_;
};

// Adds one scatterer at (x, y) to every A-line within reach.
void add_scatterer(const RfGeometry& g, double lateral_sigma_m, const PulseTable& table, double strength,
                   double x, double y, std::vector<float>& rf) {
  const double at = y / g.sample_pitch_m, whole = std::floor(at);
  const auto first = static_cast<std::ptrdiff_t>(whole) - table.reach;
  const auto samples = static_cast<std::ptrdiff_t>(g.sample_count),
             width = static_cast<std::ptrdiff_t>(table.width);
  if (first >= samples || first + width <= 0) return;
  const auto phase = std::min(kPhases - 1, static_cast<std::size_t>((at - whole) * kPhases));
  const float* values = &table.values[phase * table.width];
  const std::ptrdiff_t begin = std::max<std::ptrdiff_t>(0, -first), end = std::min(width, samples - first);
  const double line = (x - g.first_line_x_m) / g.line_pitch_m,
               reach = kReach * lateral_sigma_m / g.line_pitch_m;
  const auto from = std::max<std::ptrdiff_t>(0, static_cast<std::ptrdiff_t>(std::ceil(line - reach)));
  const auto to = std::min(static_cast<std::ptrdiff_t>(g.line_count) - 1,
                           static_cast<std::ptrdiff_t>(std::floor(line + reach)));
  for (std::ptrdiff_t l = from; l <= to; ++l) {
    const double s = (static_cast<double>(l) - line) * g.line_pitch_m / lateral_sigma_m;
    const auto weight = static_cast<float>(strength * std::exp(-.5 * s * s));
    float* out = rf.data() + l * samples + first;
    for (std::ptrdiff_t k = begin; k < end; ++k) out[k] += weight * values[k];
  }
}

double rms(const std::vector<float>& values) {
  double sum = 0;
  for (const float v : values) sum += static_cast<double>(v) * v;
  return std::sqrt(sum / static_cast<double>(std::max<std::size_t>(1, values.size())));
}

// Gaussian white noise; Box-Muller, so that a seed means the same everywhere.
std::vector<float> white(Random& random, std::size_t count) {
  std::vector<float> out(count + count % 2);
  for (std::size_t i = 0; i < out.size(); i += 2) {
    const auto radius = static_cast<float>(std::sqrt(-2 * std::log(1 - uniform(random))));
    const auto angle = static_cast<float>(2 * std::numbers::pi * uniform(random));
    out[i] = radius * std::cos(angle);
    out[i + 1] = radius * std::sin(angle);
  }
  out.resize(count);
  return out;
}

void to_unit_energy(std::vector<float>& taps) {
  const double norm = rms(taps) * std::sqrt(static_cast<double>(taps.size()));
  for (float& t : taps) t = static_cast<float>(t / norm);
}

// Columns (A-lines) filtered along depth; `in` has taps.size() - 1 more samples per line than `out`.
std::vector<float> filter_axially(const std::vector<float>& in, const std::vector<float>& taps,
                                  std::size_t samples, std::size_t lines) {
  const std::size_t padded = samples + taps.size() - 1;
  std::vector<float> out(samples * lines, 0.0f);
  for (std::size_t l = 0; l < lines; ++l)
    for (std::size_t t = 0; t < taps.size(); ++t) {
      const float tap = taps[t];
      const float* from = in.data() + l * padded + t;
      float* to = out.data() + l * samples;
      for (std::size_t k = 0; k < samples; ++k) to[k] += tap * from[k];
    }
  return out;
}

std::vector<float> filter_laterally(const std::vector<float>& in, const std::vector<float>& taps,
                                    std::size_t samples, std::size_t lines) {
  std::vector<float> out(samples * lines, 0.0f);
  for (std::size_t l = 0; l < lines; ++l)
    for (std::size_t t = 0; t < taps.size(); ++t) {
      const float tap = taps[t];
      const float* from = in.data() + (l + t) * samples;
      float* to = out.data() + l * samples;
      for (std::size_t k = 0; k < samples; ++k) to[k] += tap * from[k];
    }
  return out;
}

// Unit-RMS noise in the band f0 (1 -+ B): a difference of two Hann-windowed ideal low-passes.
std::vector<float> band_noise(Random& random, const RfGeometry& g, const Ultrasound& u) {
  constexpr int kHalf = 32;
  const double low = std::max(0.0, u.center_frequency_hz * (1 - u.bandwidth)) / u.sampling_frequency_hz;
  const double high = std::min(.5, u.center_frequency_hz * (1 + u.bandwidth) / u.sampling_frequency_hz);
  std::vector<float> taps;
  for (int k = -kHalf; k <= kHalf; ++k) {
    const double t = std::numbers::pi * k;
    const double ideal = k == 0 ? 2 * (high - low) : (std::sin(2 * high * t) - std::sin(2 * low * t)) / t;
    taps.push_back(static_cast<float>(ideal * (.5 + .5 * std::cos(t / (kHalf + 1)))));
  }
  to_unit_energy(taps);
  const auto in = white(random, (g.sample_count + taps.size() - 1) * g.line_count);
  return filter_axially(in, taps, g.sample_count, g.line_count);
}

// Unit-RMS fully developed speckle of the same PSF, from white Gaussian noise on the sampling grid.
std::vector<float> independent_speckle(Random& random, const RfGeometry& g, const Ultrasound& u) {
  const Psf psf = psf_of(u);
  const auto half_a = static_cast<int>(std::ceil(kReach * psf.axial_sigma_m / g.sample_pitch_m));
  const auto half_l = static_cast<int>(std::ceil(kReach * psf.lateral_sigma_m / g.line_pitch_m));
  std::vector<float> axial, lateral;
  for (int k = -half_a; k <= half_a; ++k)
    axial.push_back(static_cast<float>(pulse(psf, k * g.sample_pitch_m)));
  for (int l = -half_l; l <= half_l; ++l)
    lateral.push_back(
        static_cast<float>(std::exp(-.5 * std::pow(l * g.line_pitch_m / psf.lateral_sigma_m, 2))));
  to_unit_energy(axial);
  to_unit_energy(lateral);
  const std::size_t lines = g.line_count + lateral.size() - 1;
  const auto in = white(random, (g.sample_count + axial.size() - 1) * lines);
  return filter_laterally(filter_axially(in, axial, g.sample_count, lines), lateral, g.sample_count,
                          g.line_count);
}

// Of each sample of a line: what makes up for attenuation makes it louder below.
std::vector<double> noise_level(const RfBase& base) {
  const Ultrasound& u = base.ultrasound;
  std::vector<double> level(base.geometry.sample_count, std::pow(10, -u.snr_db / 20));
  if (u.attenuation_db_cm_mhz == 0) return level;
  const double per_m = attenuation_per_m_hz(u) * u.center_frequency_hz;
  double squares = 0;
  for (std::size_t k = 0; k < level.size(); ++k)
    squares += std::exp(2 * per_m * base.geometry.sample_pitch_m * static_cast<double>(k));
  const double mean = std::sqrt(squares / static_cast<double>(level.size()));
  for (std::size_t k = 0; k < level.size(); ++k)
    level[k] *= std::exp(per_m * base.geometry.sample_pitch_m * static_cast<double>(k)) / mean;
  return level;
}

std::int16_t to_counts(double value) {
  return static_cast<std::int16_t>(std::lround(std::clamp(kSpeckleCounts * value, -32767.0, 32767.0)));
}

RfGeometry geometry_of(const Tissue& tissue, const ProbeState& probe) {
  RfGeometry g;
  g.sample_pitch_m = tissue.ultrasound.sample_pitch_m();
  g.sample_count = static_cast<std::size_t>(std::floor(tissue.imaged_depth_m() / g.sample_pitch_m)) + 1;
  g.line_count = tissue.probe.lines;
  g.line_pitch_m = tissue.probe.line_pitch_m();
  g.first_line_x_m = probe.window_x_m + g.line_pitch_m / 2;
  return g;
}

}  // namespace

RfBase simulate_rf(const Tissue& tissue, const ProbeState& probe, RfFrame frame, std::uint64_t seed) {
  RfBase base{geometry_of(tissue, probe), tissue.ultrasound, {}, {}};
  const RfGeometry& g = base.geometry;
  const Ultrasound& u = base.ultrasound;
  const Psf psf = psf_of(u);
  base.pre.assign(g.values(), 0.0f);
  base.post.assign(g.values(), 0.0f);
  // Scatterers that either frame can see: the PSF's reach and the motion (at most 4 compressions) around the
  // image.
  const double bottom = tissue.imaged_depth_m() + kReach * psf.axial_sigma_m + 2 * probe.compression_m;
  const double widest = std::max(widening(u, 0), widening(u, bottom));
  const double side = kReach * psf.lateral_sigma_m * widest + 4 * probe.compression_m;
  const double left = std::max(0.0, probe.window_x_m - side);
  const double right = std::min(tissue.width_m, probe.window_x_m + probe.width_m + side);
  const double cell = 8 * std::numbers::ln2 * psf.axial_sigma_m * psf.lateral_sigma_m;
  const Pulses pulses(u, g.sample_pitch_m, bottom);
  const bool solid_beam = u.elevation_beam_m > 0;
  const double beam_sigma = u.elevation_beam_m / kFwhmPerSigma;
  double across = kBeamReach * beam_sigma * widest;
  if (tissue.solid)
    across = std::min(across, tissue.solid->elevational_width_m / 2 - std::abs(probe.window_z_m));
  const double cells = (right - left) * bottom / cell * (solid_beam ? 2 * across / u.elevation_beam_m : 1);
  const auto count = static_cast<std::size_t>(cells * kScatterersPerCell);
  Random random(seed);
  for (std::size_t n = 0; n < count; ++n) {
    const double x = left + (right - left) * uniform(random), y = bottom * uniform(random);
    const double z = solid_beam ? across * (2 * uniform(random) - 1) : 0;  // from the image plane
    const auto moved = probe.field->at(x, y, probe.window_z_m + z);
    const auto rest = frame == RfFrame::kProbe ? probe.motion(x, y) : DisplacementField::Vector{};
    const double wide = widening(u, y), sigma = psf.lateral_sigma_m * wide;
    // As loud at every depth: energy spread over a wider beam comes back from more scatterers.
    const auto strength = [&](double at_z) {
      return solid_beam ? std::exp(-.5 * std::pow(at_z / (beam_sigma * wide), 2)) / wide
                        : 1 / std::sqrt(wide);
    };
    add_scatterer(g, sigma, pulses.at(y), strength(z), x, y, base.pre);
    add_scatterer(g, sigma, pulses.at(y), strength(z + moved.z), x + moved.x - rest.x, y + moved.y - rest.y,
                  base.post);
  }
  const double scale = rms(base.pre);
  for (auto* rf : {&base.pre, &base.post})
    for (float& v : *rf) v = static_cast<float>(v / scale);
  return base;
}

RfPair with_noise(const RfBase& base, std::uint64_t seed) {
  Random random(seed);
  const double rho = base.ultrasound.correlation, fresh = std::sqrt(1 - rho * rho);
  const std::vector<double> level = noise_level(base);
  RfPair pair{base.geometry, {}, {}};
  const auto pre_noise = band_noise(random, base.geometry, base.ultrasound);
  const auto post_noise = band_noise(random, base.geometry, base.ultrasound);
  const auto other = independent_speckle(random, base.geometry, base.ultrasound);
  pair.pre.resize(base.pre.size());
  pair.post.resize(base.post.size());
  for (std::size_t i = 0; i < base.pre.size(); ++i) {
    const double noise = level[i % base.geometry.sample_count];
    pair.pre[i] = to_counts(base.pre[i] + noise * pre_noise[i]);
    pair.post[i] = to_counts(rho * base.post[i] + fresh * other[i] + noise * post_noise[i]);
  }
  return pair;
}

}  // namespace teletact::client
