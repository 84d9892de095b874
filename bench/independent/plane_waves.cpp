#include "bench/independent/plane_waves.h"

#include <Eigen/Core>
#include <algorithm>
#include <array>
#include <cmath>
#include <complex>
#include <map>
#include <numbers>
#include <random>
#include <unsupported/Eigen/FFT>

namespace teletact::bench {
namespace {

constexpr double kPi = std::numbers::pi;
// Echoes of a patch of scatterers are computed in a window of their own, of kWindow samples: as many
// frequencies as that window holds suffice. Of them those count that the array has: from kFirst on, kCount.
constexpr std::size_t kWindow = 512, kFirst = 19, kCount = 64;
constexpr double kRateHz = 80e6, kStepHz = kRateHz / kWindow, kPatchM = .002;
constexpr double kBeforeS = 2.4e-6;  // of the window, before the echo of the patch's middle
constexpr double kLateS = .8e-6,
                 kLatestS = 1.2e-6;  // waves of the array's edges that are later than that are left out
constexpr double kNearestM = .0001;

using Row = Eigen::Array<float, kCount, 1>;  // of the frequencies
struct Spectrum {
  Row re = Row::Zero(), im = Row::Zero();
  void add(float part, const Spectrum& of) { re += part * of.re, im += part * of.im; }
  void add_product(const Spectrum& a, const Spectrum& b) {
    re += a.re * b.re - a.im * b.im;
    im += a.re * b.im + a.im * b.re;
  }
};

double frequency_hz(std::size_t k) {
  return kStepHz * static_cast<double>(kFirst + k);
}

template <class Of>
Row row_of(const Of& of) {
  Row row;
  for (std::size_t k = 0; k < kCount; ++k)
    row[static_cast<Eigen::Index>(k)] = static_cast<float>(of(frequency_hz(k)));
  return row;
}

double sinc(double x) {
  return std::abs(x) < 1e-9 ? 1 : std::sin(x) / x;
}

// One cycle there, and the array's response, there and back.
Row pulse_of(const PlaneWaves& p) {
  const double f0 = p.center_frequency_hz, power = std::log(126) / std::log(2 / p.bandwidth);
  return row_of([&](double f) {
    const double off = std::abs(f - f0) / (p.bandwidth * f0 / 2 / std::pow(std::numbers::ln2, 1 / power));
    return sinc(kPi * (f - f0) / f0) * std::exp(-std::pow(off, power));
  });
}

// What element and scatterer do to a wave between them, at all frequencies.
class Paths {
 public:
  explicit Paths(const PlaneWaves& p) {
    const double nepers_m_hz = p.attenuation_db_cm_mhz * 100 * 1e-6 / (20 * std::numbers::log10e);
    for (std::size_t n = 0; n <= kAngles; ++n) {
      const double sine = static_cast<double>(n) / kAngles;
      far_.push_back(row_of([&](double f) {
        return sinc(kPi * f / p.speed_m_s * p.element_m * sine) * std::sqrt(1 - sine * sine);
      }));
    }
    for (std::size_t n = 0; n < kLengths; ++n)
      decay_.push_back(row_of([&](double f) {
        const double length_m = std::max(kNearestM, kLengthM * static_cast<double>(n));
        return std::exp(-nepers_m_hz * f * length_m) / std::sqrt(length_m);
      }));
    for (int n = 0; n < kFine; ++n) fine_.push_back(turned(n / (kRateHz * kFine)));
    for (int n = -kCoarse; n < kCoarse; ++n) coarse_.push_back(turned(n / kRateHz));
  }
  // e^(-i 2 pi f delay), to 1 / 512 of a sample.
  Spectrum phase(double delay_s) const {
    const auto steps = static_cast<std::size_t>(
        std::clamp(std::lround(delay_s * (kRateHz * kFine)) + kCoarse * kFine, 0L, 2L * kCoarse * kFine - 1));
    Spectrum s;
    s.add_product(coarse_[steps / kFine], fine_[steps % kFine]);
    return s;
  }
  Spectrum path(double aside_m, double length_m, double delay_s) const {
    Spectrum s = phase(delay_s);
    const auto sine = static_cast<std::size_t>(std::min(1., std::abs(aside_m) / length_m) * kAngles + .5);
    const auto length =
        std::min<std::size_t>(kLengths - 1, static_cast<std::size_t>(length_m / kLengthM + .5));
    const Row weight = far_[sine] * decay_[length];
    s.re *= weight, s.im *= weight;
    return s;
  }

 private:
  static constexpr std::size_t kAngles = 256, kLengths = 700;
  static constexpr double kLengthM = .0001;
  static constexpr int kFine = 256, kCoarse = 400;
  static Spectrum turned(double delay_s) {
    return {row_of([&](double f) { return std::cos(2 * kPi * f * delay_s); }),
            row_of([&](double f) { return -std::sin(2 * kPi * f * delay_s); })};
  }
  std::vector<Row> far_, decay_;
  std::vector<Spectrum> fine_, coarse_;
};

// Signals of the elements after each of the plane waves, from time 0 on, when it passes the array's middle.
class Channels {
 public:
  Channels(const PlaneWaves& p, std::span<const double> aberration_s)
      : p_(p),
        paths_(p),
        pulse_(pulse_of(p)),
        aberration_s_(aberration_s),
        length_(static_cast<std::size_t>(
            kRateHz * (4 * p.sample_pitch_m() * static_cast<double>(p.samples) / p.speed_m_s + 20e-6))),
        signals_(p.angles_rad.size() * p.elements * length_) {}

  void add_patch(double x_m, double y_m, std::span<const Scatterer> scatterers) {
    const std::size_t angles = p_.angles_rad.size();
    std::vector<Spectrum> there(scatterers.size() * angles);  // waves at the scatterers
    for (std::size_t s = 0; s < scatterers.size() * p_.elements; ++s) {
      const Scatterer& at = scatterers[s / p_.elements];
      const std::size_t n = s % p_.elements;
      const double aside_m = at.x_m - p_.x_m(n), length_m = std::hypot(aside_m, at.y_m);
      for (std::size_t a = 0; a < angles; ++a) {
        const double sent_s = p_.x_m(n) * std::sin(p_.angles_rad[a]) / p_.stated_speed_m_s + aberration_s_[n],
                     comes_s = sent_s + length_m / p_.speed_m_s,
                     late_s = comes_s - plane_s(a, at.x_m, at.y_m);
        if (late_s > kLatestS) continue;
        const double turned = std::clamp((late_s - kLateS) / (kLatestS - kLateS), 0., 1.);
        there[s / p_.elements * angles + a].add(
            static_cast<float>(at.strength * (1 + std::cos(kPi * turned)) / 2),
            paths_.path(aside_m, length_m, comes_s - plane_s(a, x_m, y_m)));
      }
    }
    for (std::size_t n = 0; n < p_.elements; ++n) {
      const double patch_m = std::hypot(x_m - p_.x_m(n), y_m);
      if (std::abs(x_m - p_.x_m(n)) > y_m + kPatchM) continue;  // hardly heard beyond 45 degrees
      std::vector<Spectrum> heard(angles);
      for (std::size_t s = 0; s < scatterers.size(); ++s) {
        const double aside_m = scatterers[s].x_m - p_.x_m(n),
                     length_m = std::hypot(aside_m, scatterers[s].y_m);
        const Spectrum path =
            paths_.path(aside_m, length_m, (length_m - patch_m) / p_.speed_m_s + aberration_s_[n]);
        for (std::size_t a = 0; a < angles; ++a) heard[a].add_product(path, there[s * angles + a]);
      }
      for (std::size_t a = 0; a < angles; ++a)
        add(a, n, plane_s(a, x_m, y_m) + patch_m / p_.speed_m_s - kBeforeS, heard[a]);
    }
  }

  double at(std::size_t angle, std::size_t element, double time_s) const {
    const double t = time_s * kRateHz;
    if (!(t >= 1 && t < static_cast<double>(length_ - 3))) return 0;
    const auto k = static_cast<std::size_t>(t);
    const double r = t - static_cast<double>(k);
    const float* s = &signals_[(angle * p_.elements + element) * length_ + k - 1];
    return s[1] + r / 2 *
                      (s[2] - s[0] +
                       r * (2 * s[0] - 5 * s[1] + 4 * s[2] - s[3] + r * (3 * (s[1] - s[2]) + s[3] - s[0])));
  }

 private:
  // When the plane wave is there, by the angle that it has in the tissue.
  double plane_s(std::size_t angle, double x_m, double y_m) const {
    const double slow = std::sin(p_.angles_rad[angle]) / p_.stated_speed_m_s, across = slow * p_.speed_m_s;
    return x_m * slow + y_m * std::sqrt(1 - across * across) / p_.speed_m_s;
  }
  void add(std::size_t angle, std::size_t element, double begin_s, const Spectrum& heard) {
    const double begin = std::floor(begin_s * kRateHz);
    Spectrum shifted;
    shifted.add_product(heard, paths_.phase(kBeforeS + begin_s - begin / kRateHz));
    std::vector<std::complex<float>> bins(kWindow), signal;
    for (std::size_t k = 0; k < kCount; ++k) {
      const auto i = static_cast<Eigen::Index>(k);
      bins[kFirst + k] = pulse_[i] * std::complex<float>(shifted.re[i], shifted.im[i]);
    }
    fft_.inv(signal, bins);
    float* out = &signals_[(angle * p_.elements + element) * length_];
    for (std::size_t k = 0; k < kWindow; ++k) {
      const double at = begin + static_cast<double>(k);
      if (at >= 0 && at < static_cast<double>(length_)) out[static_cast<std::size_t>(at)] += signal[k].real();
    }
  }

  const PlaneWaves& p_;
  Paths paths_;
  Row pulse_;
  std::span<const double> aberration_s_;
  std::size_t length_;
  std::vector<float> signals_;
  Eigen::FFT<float> fft_;
};

double uniform(std::mt19937_64& random) {
  return (static_cast<double>(random() >> 11) + .5) * 0x1p-53;
}

double gaussian(std::mt19937_64& random) {
  const double radius = std::sqrt(-2 * std::log(uniform(random)));
  return radius * std::cos(2 * kPi * uniform(random));
}

std::vector<double> aberration(const PlaneWaves& p, std::mt19937_64& random) {
  constexpr double kLengthM = .003;
  std::vector<double> white(p.elements), smooth(p.elements);
  for (double& w : white) w = gaussian(random);
  double squares = 0;
  for (std::size_t n = 0; n < p.elements; ++n) {
    for (std::size_t m = 0; m < p.elements; ++m)
      smooth[n] += white[m] * std::exp(-std::pow((p.x_m(n) - p.x_m(m)) / kLengthM, 2));
    squares += smooth[n] * smooth[n];
  }
  for (double& s : smooth) s *= p.aberration_s / std::sqrt(squares / static_cast<double>(p.elements));
  return smooth;
}

}  // namespace

double PlaneWaves::x_m(std::size_t element) const {
  return pitch_m * (static_cast<double>(element) - (static_cast<double>(elements) - 1) / 2);
}

std::vector<float> beamformed_rf(const PlaneWaves& p, std::span<const Scatterer> scatterers,
                                 std::span<const double> aberration_s) {
  std::map<std::pair<long, long>, std::vector<Scatterer>> patches;
  for (const Scatterer& s : scatterers)
    if (s.y_m > kNearestM)
      patches[{std::lround(s.y_m / kPatchM - .5), std::lround(s.x_m / kPatchM)}].push_back(s);
  Channels channels(p, aberration_s);
  for (const auto& [at, patch] : patches)
    channels.add_patch(kPatchM * static_cast<double>(at.second),
                       kPatchM * (static_cast<double>(at.first) + .5), patch);
  std::vector<float> lines(p.samples * p.elements);
  for (std::size_t k = 0; k < p.samples; ++k) {
    const double y_m = p.sample_pitch_m() * static_cast<double>(k),
                 reach_m = std::max(p.pitch_m, y_m / (2 * p.f_number));
    const double gain = std::pow(10, p.attenuation_db_cm_mhz * 1e-4 * p.center_frequency_hz * 2 * y_m / 20);
    for (std::size_t l = 0; l < p.elements; ++l) {
      const double x_m = p.x_m(l);
      double sum = 0;
      for (std::size_t n = 0; n < p.elements; ++n) {
        if (std::abs(p.x_m(n) - x_m) > reach_m) continue;
        const double back_m = std::hypot(p.x_m(n) - x_m, y_m);
        for (std::size_t a = 0; a < p.angles_rad.size(); ++a) {
          const double angle = p.angles_rad[a];
          sum += channels.at(a, n,
                             (x_m * std::sin(angle) + y_m * std::cos(angle) + back_m) / p.stated_speed_m_s);
        }
      }
      lines[k + p.samples * l] = static_cast<float>(gain * sum);
    }
  }
  return lines;
}

PlaneWavePair plane_wave_pair(const PlaneWaves& p, const Motion& motion, std::uint64_t seed) {
  constexpr double kMarginM = .004, kCellM2 = .15e-3 * .3e-3, kLargest = 24000;
  std::mt19937_64 random(seed);
  const std::vector<double> aberration_s = aberration(p, random);
  const double width_m = p.pitch_m * static_cast<double>(p.elements) + 2 * kMarginM,
               depth_m = p.sample_pitch_m() * static_cast<double>(p.samples) *
                             std::max(1., p.speed_m_s / p.stated_speed_m_s) +
                         kMarginM / 2;
  std::vector<Scatterer> pre(static_cast<std::size_t>(width_m * depth_m / kCellM2 * p.scatterers_per_cell));
  for (Scatterer& s : pre) {
    s.x_m = width_m * (uniform(random) - .5), s.y_m = depth_m * uniform(random);
    s.strength = gaussian(random);
  }
  std::vector<Scatterer> post = pre;
  for (Scatterer& s : post) {
    const Eigen::Vector2d u = motion(s.x_m, s.y_m);
    s.x_m += u.x(), s.y_m += u.y();
  }
  const std::vector<float> first = beamformed_rf(p, pre, aberration_s),
                           second = beamformed_rf(p, post, aberration_s);
  float largest = 0;
  for (const std::vector<float>* frame : {&first, &second})
    for (const float value : *frame) largest = std::max(largest, std::abs(value));
  PlaneWavePair pair;
  const auto counts = [&](float value) {
    return static_cast<std::int16_t>(std::lround(kLargest * value / largest));
  };
  std::ranges::transform(first, std::back_inserter(pair.pre), counts);
  std::ranges::transform(second, std::back_inserter(pair.post), counts);
  return pair;
}

}  // namespace teletact::bench
