#include "service/imaging/modulus/judge.h"

#include <Eigen/Core>
#include <Eigen/LU>
#include <algorithm>
#include <array>
#include <cmath>
#include <iterator>
#include <limits>
#include <stdexcept>
#include <utility>

#include "service/device/cancellation.h"
#include "service/imaging/modulus/common_deviation.h"
#include "service/imaging/modulus/neighbours.h"
#include "service/imaging/tracking/median.h"

namespace teletact::service {
namespace {

constexpr double kMaxUntracked = 0.10;  // part of the image inside the tissue
constexpr double kMaxDeviation = 0.25;  // median standard deviation of log E
constexpr double kMaxRamp = 1.25;       // of the background's modulus from one end of the window to the other
constexpr double kMaxLateralRatio = 0.25;  // of - eps_xx / eps_yy, from what the plane assumption says
constexpr double kMaxPressure = 0.10;      // of log E when nu is off by its deviation
constexpr double kPoissonError = 0.01;     // that, where it is not stated
// Part of the window that is no background, beyond what inclusions of 15 mm show.
constexpr double kMaxExtent = 0.14;
// Median difference of log E from what other windows told, in deviations of both together.
constexpr double kMaxDisagreement = 3;
constexpr double kBackgroundLog = 0.4;  // of log E, about the ramp: what it is judged by
constexpr double kGuessLog = 0.69;      // of log E, from which on it is one: a factor of two
constexpr double kMisfitLog = 2.3;      // of log E: a factor of ten
constexpr double kOfExtent = 2;         // of log E, for each part of the window beyond the usual
constexpr double kSoftLog = 0.1;        // log(background / E) from which on it is soft; fully at twice that
constexpr double kSmear = 0.4;          // standard deviation of a triangular kernel over its reach

// Slopes of log E between the nearest said nodes on both sides, per node of the image grid.
double jump_over(const Field& e, const ImageGrid& g, std::size_t n) {
  const std::size_t i = n % g.nx, j = n / g.nx;
  const auto slope = [&](std::size_t low, std::size_t high, double distance) {
    const double s = std::log(e[high] / e[low]) / distance;
    return std::isfinite(s) ? s : 0.0;
  };
  const std::size_t left = i > 0 ? n - 1 : n, right = i + 1 < g.nx ? n + 1 : n;
  const std::size_t above = j > 0 ? n - g.nx : n, below = j + 1 < g.ny ? n + g.nx : n;
  const double x = slope(left, right, g.x_m(right) - g.x_m(left));
  const double y = slope(above, below, g.y_m(below) - g.y_m(above));
  return std::hypot(x * kSlopeReachXM, y * kSlopeReachYM);
}

// Errors of log E without any noise: everywhere; as a part of |log(E / background)|, which every method falls
// short of (the stress that an inclusion draws to itself, total variation), both measured on 80 windows of
// the simulated patient, contrasts of 2 to 10; where it is softer than the background, since what is given up
// of small contrasts on the border is most of a soft inclusion's. `off_log`: |log(E / background)| from which
// on a place is no background; `usual`: part of the window that is none with an inclusion of 15 mm. The solid
// method leaves patches of texture in the background, and a ramp as it is: neither fills the window.
struct MethodError {
  double floor, of_contrast, soft, off_log, usual;
};
MethodError method_error(ModulusKind kind) {
  switch (kind) {
    case ModulusKind::kReferenceStress:
      return {0.06, 0.25, 0.33, 0.15, 0.25};
    case ModulusKind::kDirect:
      return {0.045, 0.12, 0.3, 0.15, 0.13};
    case ModulusKind::kIterative:
      return {0.03, 0.075, 0.15, 0.15, 0.13};
    case ModulusKind::kSolid:
      return {0.03, 0.12, 0.15, 0.3, 0.12};
  }
  throw std::logic_error("modulus kind");
}

void widen(Field& log_deviation, double by) {
  for (float& d : log_deviation) d = static_cast<float>(std::hypot(d, by));
}

// By what all places share.
void widen_all(ModulusEstimate& out, double by) {
  widen(out.log_deviation, by);
  if (out.log_modes.count() > 0) out.log_modes.add_everywhere(by);
}

// Median over the nodes that say something.
double typical(const Field& field) {
  std::vector<float> said;
  std::ranges::copy_if(field, std::back_inserter(said), [](float v) { return std::isfinite(v); });
  return said.empty() ? 0 : median(said);
}

// Over the nodes that say something.
double mean_square(const Field& field) {
  double squares = 0, said = 0;
  for (const float d : field)
    if (std::isfinite(d)) squares += d * d, ++said;
  return said > 0 ? squares / said : 0;
}

// 1, and the node's place in the window from 0 to 1.
Eigen::Vector3d place_of(const ModulusInput& in, std::size_t n) {
  const ImageGrid& g = in.measured.grid;
  return {1, (g.x_m(n) - g.origin_x_m) / in.window_width_m,
          (g.y_m(n) - g.origin_y_m) / (static_cast<double>(g.ny - 1) * g.dy_m)};
}

// Whether log E is no guess there. Where a solid's strain tells nothing it is drawn to the background.
bool told_at(const ModulusEstimate& out, std::size_t n) {
  return std::isfinite(out.youngs_modulus[n]) &&
         (out.kind != ModulusKind::kSolid || out.log_deviation[n] < kGuessLog);
}

// A plane through log E of what looks like background, which is what lies about the plane: the traction under
// a flat frictionless probe leaves none.
Eigen::Vector3d background_plane(const ModulusInput& in, const ModulusEstimate& out, bool with_guesses) {
  constexpr int kPasses = 3;
  Eigen::Vector3d plane = Eigen::Vector3d::Zero();
  for (int pass = 0; pass < kPasses; ++pass) {
    Eigen::Matrix3d normal = Eigen::Matrix3d::Zero();
    Eigen::Vector3d load = Eigen::Vector3d::Zero();
    for (std::size_t n = 0; n < out.youngs_modulus.size(); ++n) {
      if (n % in.measured.grid.nx == 0) check_cancelled();
      const double logarithm = std::log(out.youngs_modulus[n] / out.background);
      const Eigen::Vector3d f = place_of(in, n);
      if (!(with_guesses || told_at(out, n)) || !(std::abs(logarithm - plane.dot(f)) < kBackgroundLog))
        continue;
      normal += f * f.transpose();
      load += logarithm * f;
    }
    plane = normal.fullPivLu().solve(load);
  }
  return plane;
}

// |log E| from the background, of a solid from its ramp.
std::vector<double> from_background(const ModulusInput& in, const ModulusEstimate& out) {
  const Eigen::Vector3d plane =
      out.kind == ModulusKind::kSolid ? background_plane(in, out, true) : Eigen::Vector3d::Zero();
  std::vector<double> off(out.youngs_modulus.size());
  for (std::size_t n = 0; n < off.size(); ++n)
    off[n] = std::abs(std::log(out.youngs_modulus[n] / out.background) - plane.dot(place_of(in, n)));
  return off;
}

// The axial strain's noise; where that is not measured the modulus is a guess: within a factor of two. None
// of the methods knows what a jump of the modulus is smeared over, and which part of a contrast is kept. One
// that has found its posterior knows its noise better than the strain does, as long as the strain tells
// something: else it states its prior.
struct OwnDeviation {
  double mean_square;  // of what correlates as the method says; the rest is alike all around
  double noise;        // of the strain, over it: median
};
OwnDeviation deviation(const ModulusInput& in, ModulusEstimate& out) {
  const Measured& m = in.measured;
  const MethodError error = method_error(out.kind);
  const auto nowhere = std::numeric_limits<float>::quiet_NaN();
  const Field posterior = std::exchange(out.log_deviation, Field(m.grid.size(), nowhere));
  Field of_model(m.grid.size(), nowhere), noises = of_model;
  for (std::size_t n = 0; n < m.grid.size(); ++n) {
    if (n % m.grid.nx == 0) check_cancelled();
    if (!std::isfinite(out.youngs_modulus[n])) continue;
    const double smeared = kSmear * jump_over(out.youngs_modulus, in.measured.grid, n);
    const double logarithm = std::log(out.youngs_modulus[n] / out.background);
    const double soft = error.soft * std::clamp(-logarithm / kSoftLog - 1, 0.0, 1.0);
    of_model[n] = static_cast<float>(std::hypot(smeared, error.of_contrast * logarithm, soft));
    const float noise = m.axial_strain_noise[n] / std::abs(m.axial_strain[n]);
    const double own = std::isfinite(noise) ? noise : std::log(2.0);
    noises[n] = static_cast<float>(m.strain_valid[n] ? own : std::log(2.0));
    out.log_deviation[n] = static_cast<float>(std::hypot(own, of_model[n], error.floor));
  }
  const bool telling = typical(out.log_deviation) <= kMaxDeviation;
  const bool solid = out.kind == ModulusKind::kSolid;
  const bool with_posterior = !posterior.empty() && (telling || solid);
  if (with_posterior) {
    // That of a solid also holds what was fitted, and where no strain tells anything.
    for (std::size_t n = 0; n < posterior.size(); ++n) {
      const float own = std::hypot(posterior[n], of_model[n]);
      out.log_deviation[n] = telling ? own : std::max(own, out.log_deviation[n]);
    }
  }
  return {mean_square(with_posterior && telling ? posterior : out.log_deviation), typical(noises)};
}

bool warned(const ModulusEstimate& e, ModulusFlag flag) {
  return std::ranges::find(e.warnings, flag, &Warning::flag) != e.warnings.end();
}

void untracked(const ModulusInput& in, ModulusEstimate& out) {
  const std::vector<std::uint8_t>& trusted = in.measured.displacement_valid;
  double inside = 0, without = 0;
  // Below coupling tissue is told from a kernel's length on.
  const auto first = in.measured.coupling_m > 0 ? std::ranges::find(trusted, 1) - trusted.begin() : 0;
  for (std::size_t n = static_cast<std::size_t>(first); n < trusted.size(); ++n) {
    if (const double y_m = in.measured.grid.y_m(n); y_m < 0 || y_m > in.tissue.depth_m) continue;
    ++inside;
    if (!trusted[n]) ++without;
  }
  if (without > kMaxUntracked * inside)
    out.warn(ModulusFlag::kUntracked,
             "{:.0f} % of the image could not be tracked (no echo, or low correlation): it has no modulus "
             "there, and beside it the modulus depends on the model",
             100 * without / inside);
}

// Less than the noise of each strain is none.
void ramp(const ModulusInput& in, double noise, ModulusEstimate& out) {
  const Eigen::Vector3d plane = background_plane(in, out, false);
  Eigen::Array3d least = Eigen::Array3d::Constant(HUGE_VAL), most = -least;  // of the places that are said
  for (std::size_t n = 0; n < out.youngs_modulus.size(); ++n)
    if (std::isfinite(out.youngs_modulus[n]))
      least = least.min(place_of(in, n).array()), most = most.max(place_of(in, n).array());
  const auto factor = [&](Eigen::Index k) {
    return std::exp(std::abs(plane[k]) * std::max(0.0, most[k] - least[k]));
  };
  const double across = factor(1), down = factor(2);
  if (std::max(across, down) > std::max(kMaxRamp, std::exp(noise)))
    out.warn(ModulusFlag::kRamp,
             "the background's modulus ramps by a factor of {:.2f} across and {:.2f} down the window: the "
             "probe may be tilted or touch in part, or the tissue is larger or smaller than stated",
             across, down);
}

void out_of_plane(const ModulusInput& in, ModulusEstimate& out) {
  const std::optional<double> ratio = lateral_ratio(in.measured);
  const double nu = in.tissue.poisson_ratio;
  const double expected = out.lateral_ratio.value_or(in.tissue.plane == Plane::kStrain ? nu / (1 - nu) : nu);
  if (ratio && std::abs(*ratio - expected) > kMaxLateralRatio)
    out.warn(
        ModulusFlag::kOutOfPlane,
        "the tissue spreads sideways by {:.2f} of its axial strain, not by {:.2f} as assumed: it gives way "
        "across the image plane, or nu or the plane condition is another; the modulus is off by a third "
        "to twofold{}",
        *ratio, expected,
        in.tissue.plane == Plane::kSolid ? "" : "; a narrow probe on wide tissue is a SOLID");
}

// |d log P / d nu| times nu's deviation (T3.4), of which common_deviation() holds what the modulus moves by.
// Near nu = 1/2 the tissue carries the push by pressure as far as it cannot give way sideways. Pressure
// leaves no trace in the displacement: the scale of the modulus then hangs on nu.
void pressure(const ModulusInput& in, StripCache& strips, ModulusEstimate& out) {
  if (!in.force) return;
  // Under a narrow face the tissue gives way across the plane.
  if (out.kind == ModulusKind::kSolid && in.force->contact_area_m2 < in.window_width_m * in.tissue.depth_m)
    return;
  const double error = in.tissue.poisson_std > 0 ? in.tissue.poisson_std : kPoissonError,
               off = error * std::abs(strips.get(in.tissue, in.window_width_m)->log_force_slope);
  if (!(off > kMaxPressure)) return;
  out.warn(ModulusFlag::kPressure,
           "the tissue is confined and nearly incompressible: pressure carries the probe's force, which the "
           "displacement does not show, and the modulus changes by {:.0f} % when the Poisson ratio ({:.4g}) "
           "is off by {:.2g}",
           100 * off, in.tissue.poisson_ratio, error);
}

// Median of log(E / known) over both deviations, with those of both forces, the other taken for as uncertain
// as this one (T3.4). A wrong force scales the whole map; only other windows can tell.
void scale(const ModulusInput& in, ModulusEstimate& out) {
  if (!in.force || !in.known) return;
  const auto [worst, shift] = worst_disagreement(in, out);
  if (!(worst > kMaxDisagreement)) return;
  widen_all(out, shift);
  out.warn(ModulusFlag::kScale,
           "the modulus is {:.2f} times what was found before beside this window or in it, {:.1f} standard "
           "deviations: one of the probe's two forces is wrong, or its contact was not whole",
           std::exp(shift), worst);
}

// A lump that fills much of the window comes back short, least so where it is taken for background.
void extent(const ModulusInput& in, ModulusEstimate& out) {
  const MethodError error = method_error(out.kind);
  const std::vector<double> from = from_background(in, out);
  double said = 0, away = 0;
  for (std::size_t n = 0; n < from.size(); ++n) {
    if (!told_at(out, n)) continue;
    ++said, away += from[n] > error.off_log;
  }
  const double off = said > 0 ? away / said : 0, beyond = off - error.usual;
  for (std::size_t n = 0; beyond > 0 && n < out.log_deviation.size(); ++n)
    out.log_deviation[n] = static_cast<float>(
        std::hypot(out.log_deviation[n],
                   kOfExtent * beyond * std::clamp(1.5 * from[n] / error.off_log - 0.5, 0.0, 1.0)));
  if (beyond > kMaxExtent)
    out.warn(ModulusFlag::kExtent,
             "{:.0f} % of the window differ from its background: what fills so much of it comes back with "
             "too little contrast, and the background is off with it",
             100 * off);
}

// A solid that no model explains, or whose face touches in part, may be off by a factor anywhere, and alike
// all around: lumps below such a face were, by up to e^4.5. Last: the other flags are of what the method
// itself states.
void misfit(ModulusEstimate& out) {
  if (warned(out, ModulusFlag::kMisfit) && out.kind == ModulusKind::kSolid) widen_all(out, kMisfitLog);
}

// A part of the deviation, and the warning that it belongs to.
struct Part {
  ModulusFlag cause;
  double deviation;
  bool stated = false;  // by who asks: the deviations of force and tissue
};

const char* words_of(ModulusFlag cause, bool stated) {
  if (stated) return ": that is what the stated deviations of force, area, pad and tissue leave open";
  if (cause == ModulusFlag::kNoise) return ": the strain is noisy; press further between the frames";
  if (cause == ModulusFlag::kUnstated)
    return ": that is what the probe's elevation or the tissue's depth, which were not stated, or not well, "
           "change in it";
  return ": the strain fits models of the tissue whose modulus differs; state the tissue's size and the face";
}

// Says how uncertain the map is as a whole, and for each part that is a reason by itself, or the largest,
// why. What no part accounts for is the noise's where there is as much of it; else, of a solid, that of what
// has warned or the models'.
void uncertain(std::vector<Part> parts, double noise, ModulusEstimate& out) {
  const double all = typical(out.log_deviation);
  if (!(all > kMaxDeviation)) return;
  // Under a misfit what lies between the models is not told from it.
  if (!warned(out, ModulusFlag::kMisfit)) parts.push_back({ModulusFlag::kModels, out.model_deviation});
  parts.push_back({ModulusFlag::kUnstated, out.unstated_deviation});
  parts.push_back({ModulusFlag::kUnstated, out.common_deviation, true});
  double left = all * all;
  for (const Part& part : parts) left -= part.deviation * part.deviation;
  left = std::sqrt(std::max(0.0, left));
  const auto cause_of_left = [&] {
    if (out.kind != ModulusKind::kSolid || noise > left / 2) return ModulusFlag::kNoise;
    for (const ModulusFlag flag :
         {ModulusFlag::kMisfit, ModulusFlag::kCut, ModulusFlag::kDeadline, ModulusFlag::kRamp})
      if (warned(out, flag)) return flag;
    return ModulusFlag::kModels;
  };
  parts.push_back({cause_of_left(), left});
  const double largest = std::ranges::max(parts, {}, &Part::deviation).deviation;
  const std::string size = fmt::format(
      "the modulus is uncertain by {} (median)",
      all < 1 ? fmt::format("{:.0f} %", 100 * all) : fmt::format("a factor of {:.1f}", std::exp(all)));
  for (const Part& part : parts) {
    if (part.deviation < std::min(largest, kMaxDeviation)) continue;
    const auto said = std::ranges::find(out.warnings, part.cause, &Warning::flag);
    if (said == out.warnings.end())
      out.warn(part.cause, "{}{}", size, words_of(part.cause, part.stated));
    else if (said->text.find(size) == std::string::npos)
      out.warn(part.cause, "{}", size);
  }
}

}  // namespace

double correlation_with_common(double length_m, double own, double common) {
  constexpr double kFeltM = 5e-3, kMax = 0.99;
  const double share = (own * std::exp(-kFeltM / length_m) + common) / (own + common);
  return -kFeltM / std::log(std::min(share, kMax));
}

void no_background(double spread, double noise, ModulusEstimate& out) {
  constexpr double kDeviationOfHalf = 1.48, kMaxSpread = kDeviationOfHalf * 0.6931;
  if (spread > std::hypot(kMaxSpread, noise))
    out.warn(ModulusFlag::kMisfit,
             "the modulus does not settle, and half of it came to lie beyond a factor of {:.1f} about its "
             "middle: no tissue explains the strain; the face may touch in part; press it flat",
             std::exp(spread / kDeviationOfHalf));
}

void judge(const ModulusInput& in, StripCache& strips, ModulusEstimate& out) {
  out.common_deviation = common_deviation(in, strips, out);
  const OwnDeviation own = deviation(in, out);
  untracked(in, out);
  ramp(in, own.noise, out);
  out_of_plane(in, out);
  std::vector<Part> parts;
  const auto widened_by = [&](ModulusFlag cause, const auto& step) {
    const double before = typical(out.log_deviation);
    step();
    if (!warned(out, cause)) return;
    const double after = typical(out.log_deviation);
    parts.push_back({cause, std::sqrt(std::max(0.0, after * after - before * before))});
  };
  pressure(in, strips, out);
  widened_by(ModulusFlag::kScale, [&] { scale(in, out); });
  check_cancelled();
  widened_by(ModulusFlag::kExtent, [&] { extent(in, out); });
  widened_by(ModulusFlag::kMisfit, [&] { misfit(out); });
  widen_all(out, out.common_deviation);
  uncertain(std::move(parts), own.noise, out);
  out.median_deviation = typical(out.log_deviation);
  const double common = mean_square(out.log_deviation) - own.mean_square;
  if (common > 0) out.correlation_m = correlation_with_common(out.correlation_m, own.mean_square, common);
}

}  // namespace teletact::service
