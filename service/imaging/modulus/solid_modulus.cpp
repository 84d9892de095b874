#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <stdexcept>
#include <utility>
#include <vector>

#include "service/device/cancellation.h"
#include "service/imaging/modulus/cell_strains.h"
#include "service/imaging/modulus/denoiser.h"
#include "service/imaging/modulus/fixed_point.h"
#include "service/imaging/modulus/judge.h"
#include "service/imaging/modulus/modulus.h"
#include "service/imaging/modulus/one_slice.h"
#include "service/imaging/modulus/pad.h"
#include "service/imaging/modulus/probe_fit.h"
#include "service/imaging/modulus/probed_tissue.h"
#include "service/imaging/modulus/robust_fit.h"
#include "service/imaging/modulus/seed.h"
#include "service/imaging/modulus/skin.h"
#include "service/imaging/tracking/median.h"

namespace teletact::service {
namespace {

using Eigen::Index;
using Eigen::VectorXd;

// A step takes more than it should alone: where pressure carries the load, strain hardly follows the modulus.
constexpr double kOverstep = 1.4;
constexpr double kUnobservedLog = 0.6931;  // ln 2: of what no strain tells
// Of ln(strain) in a cell, what no modulus of it explains: as the map is smoothed for it, and as its
// deviations state it. These hold 97.9 % of the nodes of truths of other elements and speckle; 0.05, and 0.06
// in common to all cells, held 98.9 %.
constexpr double kCellModelLog = 0.05, kStatedModelLog = 0.03;
constexpr double kTiltLog = 0.25;  // of the tilt: the tissue's own ramp may look like it
constexpr double kMaxTilt = 0.5;
constexpr double kRangeLog = 3;         // of ln E about the background
constexpr double kCorrelationM = 5e-3;  // of what each cell tells by itself
constexpr double kMaxRest = 0.15;       // of the strain, unexplained
// Change of the push from the middle of the face to an end: more is no tilt. Where an end does not touch, the
// tilt that is fitted goes to its bound.
constexpr double kMaxUneven = 0.35;
// Error of a lump's ln E: balls and cylinders of contrast 3 come back 0.94 to 1.1 times as stiff.
constexpr double kOneSliceLog = 0.1;
constexpr double kOneSliceOfBlockLog = 0.2;  // of tissue as wide as the probe, which a sphere may fill
constexpr double kUnsettledLog = 0.5;        // of the last step, where the time ended before it was small
// ln E about the background: stiffer tissue hardly strains, so that how stiff it is nobody knows. As long
// as it bears little of the force, that does not matter.
constexpr double kStiffLog = 1.8, kMaxOfStiff = 1.3;
constexpr double kContradictedScale = 3;  // deviations between what force and pad say of the scale

class SolidModulusMethod : public ModulusMethod {
 public:
  SolidModulusMethod(const Queue& queue, const StrainOptions& strain, std::shared_ptr<StripCache> strips)
      : strain_(strain), fitter_(queue, strain, std::move(strips)) {}

  ModulusEstimate estimate(const ModulusInput& in) override {
    validate(in.force);
    ModulusEstimate out;
    out.kind = ModulusKind::kSolid;
    out.absolute = in.force || in.tissue.pad;
    std::vector<float> trusted;
    for (std::size_t n = 0; n < in.measured.grid.size(); ++n)
      if (in.measured.strain_valid[n]) trusted.push_back(in.measured.axial_strain[n]);
    out.mean_axial_strain = mean_strain(std::move(trusted));
    double elevation_m = in.tissue.probe_elevation_m;
    if (!(elevation_m > 0) && in.force) elevation_m = in.force->contact_area_m2 / in.window_width_m;
    const auto most = [&](FitEffort effort) {
      return ProbeFitter::max_solves(effort, in.tissue.pad.has_value());
    };
    const auto affords = [&](FitEffort effort) {
      return in.budget.solves >= most(effort) + solves_of(kUsualSteps + kForcePushes);
    };
    const FitEffort effort = affords(FitEffort::kAllStarts) ? FitEffort::kAllStarts
                             : affords(FitEffort::kWeighed) ? FitEffort::kWeighed
                                                            : FitEffort::kUsual;
    // By what the fit may solve, not by what it did: that depends on what is kept of the pair before.
    const int left = std::min(in.budget.solves - most(effort) - 1, kMaxSteps),
              steps = std::clamp(kPushesPerSolve * left - kForcePushes, 1, kMaxSteps);
    const ProbeFit fit = fitter_.fit(in, elevation_m, out.mean_axial_strain < 0 ? -1 : 1, effort);
    out.solves = fit.solves;
    out.lateral_ratio = fit.lateral_ratio;
    out.model = fit.words;
    const ProbedTissue::Planes beside = planes_told(in.beside, *fit.tissue, fit.top_m, kRangeLog);
    if (!beside.empty())
      out.model += fmt::format("; slices of it are known from {:.1f} to {:.1f} mm across the image",
                               1e3 * beside.front().offset_m, 1e3 * beside.back().offset_m);
    if (fit.as_usual)
      out.warn(ModulusFlag::kCut,
               "the probe's elevation or the tissue's depth was not stated, and there was no time to fit it "
               "({}): it is taken as usual; state it, or give more time",
               in.budget.why_solves);
    if (fit.unweighed)
      out.warn(ModulusFlag::kCut,
               "{:.0f} % of the strain is unexplained, and there was no time ({}) to try {}; give more time",
               100 * fit.rest, in.budget.why_solves, fit.untried);
    else if (!fit.untried.empty())
      out.warn(ModulusFlag::kCut, "there was no time ({}) to try {}; give more time", in.budget.why_solves,
               fit.untried);
    if (!fit.contradicted.empty())
      out.warn(ModulusFlag::kElevation, "{}; the modulus follows the strain: check what you stated",
               fit.contradicted);
    if (fit.rest > std::hypot(kMaxRest, level_of(fit.measured.deviation, fit.measured.observed)))
      out.warn(ModulusFlag::kMisfit,
               "neither solid tissue nor a block explains the strain: {:.0f} % of it is left where it looks "
               "homogeneous; check the probe's size and the tissue's depth and support",
               100 * fit.rest);
    Found found = find(in, fit, beside, steps, out);
    const double log_scale = scale(in, fit, found, out);
    publish(in, fit, found, log_scale, out);
    // Of a strain that is not explained others are told nothing.
    if (!fit.unweighed && std::ranges::none_of(out.warnings, [](const Warning& w) {
          return w.flag == ModulusFlag::kMisfit || w.flag == ModulusFlag::kElevation;
        }))
      out.told = fit.told;
    return out;
  }

  void forget() override { fitter_.forget(); }

 private:
  // What has not settled after the usual steps goes on where there are solves for more, no longer hastened:
  // where strain hardly follows the modulus a mix of steps swings.
  static constexpr int kUsualSteps = 12, kMaxSteps = 24, kForcePushes = 4;
  static constexpr int kPushesPerSolve = 2;  // of those that begin at the last one's solution
  static int solves_of(int pushes) { return 1 + pushes / kPushesPerSolve; }
  // Rms change of log E over the cells: what ends the steps, and what is settled where they run out.
  static constexpr double kLastStep = 0.004, kConvergedStep = 0.01;

  struct Found {
    VectorXd log_modulus;              // of the cells, E in Pa under which the probe bears force_n
    VectorXd own_deviation;            // of it: what is known cell by cell,
    std::vector<VectorXd> modes = {};  // and its change by one deviation of each cause that many share
    double force_n = 0, pad_log = 0;   // under which a pad has this ln E
  };

  // A map that was solved, and what it shows.
  struct Solved {
    double cost = HUGE_VAL, tilt = 0, tilt_deviation = 0;
    VectorXd log_modulus, moved, observed;
  };

  static ProbedTissue::Response pushed(const ProbeFit& fit, const VectorXd& theta, double tilt,
                                       const ProbedTissue::Planes& beside, bool again) {
    const VectorXd with_top = theta + fit.above;
    auto planes = planes_between(with_shared_lumps(beside, with_top), with_top, *fit.tissue);
    planes = planes_beyond(std::move(planes), with_top, *fit.tissue);
    return again ? fit.tissue->push_again(with_top, tilt, planes) : fit.tissue->push(with_top, tilt, planes);
  }

  // E <- E eps[E] / eps, with total variation, and the tilt that what is left shows.
  Found find(const ModulusInput& in, const ProbeFit& fit, const ProbedTissue::Planes& beside, int steps,
             ModulusEstimate& out) const {
    const CellGrid& cells = fit.tissue->cells();
    const auto size = static_cast<Index>(cells.size());
    // Cells share what the strain's kernel covers.
    const double share = cells.spacing_m * cells.row_m / (strain_.kernel_axial_m * strain_.kernel_lateral_m);
    const auto weighed = [&](double model_log) -> VectorXd {
      return (fit.measured.observed.array() > 0)
          .select(share / (fit.measured.deviation.array().square() + squared(model_log)), 0.0);
    };
    const VectorXd weight = weighed(kCellModelLog), stated = weighed(kStatedModelLog);
    Denoiser denoise(cells);
    const auto columns = static_cast<Index>(cells.columns),
               pad = columns * static_cast<Index>(std::lround(fit.face.pad_m / cells.row_m));
    Found found{VectorXd::Zero(size), VectorXd::Zero(size)};
    VectorXd& theta = found.log_modulus;
    double tilt = 0, tilt_deviation = 0, spread = 0;
    FixedPoint hastened;
    VectorXd observed = weight, moved = VectorXd::Zero(size);
    // Where strain hardly follows the modulus the steps do not settle: they lead past the likeliest.
    Solved last, likeliest;
    bool too_uneven = false;
    out.converged = false;
    while (out.iterations < steps) {
      check_cancelled();
      // First without the others, which hold up what this slice has not been given yet.
      const bool first = out.iterations == 0;
      ProbedTissue::Response response;
      try {
        response = pushed(fit, theta, tilt, first ? ProbedTissue::Planes{} : beside, !first);
      } catch (const std::invalid_argument&) {  // a map of noise may be
        if (first) throw;
        too_uneven = true;
        break;
      }
      const VectorXd strain = -as_measured(response.axial_strain, cells, strain_);
      VectorXd residual = VectorXd::Zero(size), extended = residual;
      observed = weight;
      for (Index c = 0; c < size; ++c)
        if (!(strain[c] > 0))
          observed[c] = 0, extended[c] = kRangeLog;
        else if (observed[c] > 0)
          residual[c] = std::log(strain[c]) - fit.measured.log_strain[c];
      if (!(observed.maxCoeff() > 0))
        throw NoCompression("no cell of the strain map tells a modulus; press further between the frames");
      const RobustFit at =
          fit_robustly(theta + residual, observed, {{-fit.by_tilt, -tilt, kUsualTilt, false}},
                       cells.spacing_m * cells.row_m / kAlikeM2);
      spread = at.rest;
      const double before = tilt;
      tilt = std::clamp(tilt + at.at[0], -kMaxTilt, kMaxTilt);
      tilt_deviation = std::sqrt(at.covariance(0, 0));
      residual += (tilt - before) * fit.by_tilt;
      residual.array() -= level_of(residual, observed);
      const VectorXd pseudo =  // log E + 1.4 (log S eps[E] - log eps), T3.6
          (theta + kOverstep * residual).cwiseMax(-kRangeLog).cwiseMin(kRangeLog);
      // Unobserved cells begin at the background.
      const VectorXd start =
          out.iterations == 0 ? VectorXd((observed.array() > 0).select(pseudo, 0.0)) : theta;
      VectorXd denoised = denoise(pseudo, observed / kOverstep, start);
      if (!(fit.face.beside_m > 0) || fit.face.slides) hold_columns(denoised, cells);
      if (pad > 0) {  // all of it is alike
        const auto told = observed.head(pad);
        if (told.sum() > 0) denoised.head(pad).setConstant(told.dot(pseudo.head(pad)) / told.sum());
      }
      moved = denoised - theta;
      const double change = std::sqrt(moved.squaredNorm() / static_cast<double>(size));
      if (out.iterations < kUsualSteps) denoised = hastened.next(theta, denoised);
      // A cell that it would extend is as far off as any.
      last = {denoise.cost((residual.array() * (observed.array() > 0).cast<double>()).matrix() + extended,
                           weight, theta),
              tilt,
              tilt_deviation,
              theta,
              moved,
              observed};
      if (last.cost < likeliest.cost && (!first || beside.empty())) likeliest = last;
      theta = denoised.cwiseMax(-kRangeLog).cwiseMin(kRangeLog);
      ++out.iterations;
      out.converged = change < kConvergedStep;
      if (change < (out.iterations < kUsualSteps ? kLastStep : kConvergedStep)) break;
    }
    const auto go_back_to = [&](const Solved& solved) {
      theta = solved.log_modulus, moved = solved.moved, observed = solved.observed, out.converged = false;
      tilt = solved.tilt, tilt_deviation = solved.tilt_deviation;
    };
    if (too_uneven) go_back_to(last);
    // What the last map looks like warns; the likeliest is published.
    bool passed = !out.converged && (too_uneven || likeliest.cost < last.cost);
    int pushes = out.iterations;
    const auto force_of = [&](const VectorXd& map) {
      ++pushes;
      return force_with(fit, map, tilt, observed, beside);
    };
    bool stiff = theta.maxCoeff() > kStiffLog;
    if ((in.force && !passed) || stiff) try {
        found.force_n = force_of(theta);
      } catch (const std::invalid_argument&) {
        go_back_to(last), too_uneven = passed = true;
        stiff = theta.maxCoeff() > kStiffLog;
        if (stiff) found.force_n = force_of(theta);
      }
    if (!out.converged)
      out.warn(steps < kMaxSteps && !too_uneven ? ModulusFlag::kCut : ModulusFlag::kDeadline,
               "the modulus of the solid had not settled after {} step(s){}", out.iterations,
               too_uneven          ? ": the next is too uneven to be solved"
               : steps < kMaxSteps ? fmt::format(": there was no time for more ({})", in.budget.why_solves)
                                   : ", the most");
    if (!out.converged && out.iterations == kMaxSteps)
      no_background(spread, level_of(fit.measured.deviation, fit.measured.observed), out);
    if (std::abs(tilt) > kMaxUneven)
      out.warn(ModulusFlag::kMisfit,
               "the face pushes {:.0f} % less at the window's {} end than at its middle: it seems to touch "
               "in part, and the modulus is off by a factor; press it flat",
               100 * std::abs(tilt), tilt > 0 ? "left" : "right");
    if (stiff) {
      const double without_n = force_of(theta.cwiseMin(kStiffLog));
      if (found.force_n > kMaxOfStiff * without_n)
        out.warn(
            ModulusFlag::kMisfit,
            "the force would be {:.1f} times as large for places that hardly strain, over {:.0f} % of the "
            "window: there the face seems not to touch, and the modulus is off by a factor; press it flat",
            found.force_n / without_n,
            100 * static_cast<double>((theta.array() > kStiffLog).count()) /
                static_cast<double>(theta.size()));
    }
    if (passed) {
      go_back_to(likeliest.cost < HUGE_VAL ? likeliest : last);
      if (in.force) found.force_n = force_of(theta);
    }
    out.solves += solves_of(pushes);
    found.own_deviation = denoise.deviation((observed.array() > 0).select(stated, 0.0), theta);
    const double one_slice = fit.face.beside_m > 0 ? kOneSliceLog : kOneSliceOfBlockLog;
    const double of_tilt = std::hypot(tilt_deviation, kTiltLog * tilt);
    double all_own = 0, all_common = 0;
    const Index top = pad > 0 ? pad : columns * static_cast<Index>(kSkinLayers);
    const double of_top = pad > 0                                            ? 0
                          : in.tissue.surface.kind == Surface::Kind::kUneven ? kUnobservedLog
                                                                             : kSkinVariesLog;
    const auto typical = [&](const VectorXd& of) {
      return of.tail(size - top).norm() / std::sqrt(static_cast<double>(size - top));
    };
    out.model_deviation = std::hypot(typical(fit.between), fit.untried_log);
    for (const VectorXd& change : fit.changes)
      out.unstated_deviation = std::hypot(out.unstated_deviation, typical(change));
    found.modes = fit.changes;
    found.modes.insert(found.modes.end(), fit.between_modes.begin(), fit.between_modes.end());
    found.modes.push_back(VectorXd::Constant(size, fit.common_log));
    found.modes.push_back(of_tilt * fit.by_tilt);
    for (Index c = 0; c < size; ++c) {
      double own = c < top ? squared(of_top)
                           : std::pow(found.own_deviation[c], 2) + std::pow(one_slice * theta[c], 2),
             between = squared(fit.between[c]), common = 0;
      for (const VectorXd& mode : fit.between_modes) between -= squared(mode[c]);
      own += std::max(0.0, between);
      if (!out.converged) own += std::pow(kUnsettledLog * moved[c], 2);
      for (const VectorXd& mode : found.modes) common += squared(mode[c]);
      if (observed[c] > 0) all_own += own, all_common += common;
      if (c >= top && !(observed[c] > 0)) own = std::max(own, squared(kUnobservedLog) - common);
      found.own_deviation[c] = std::sqrt(own);
    }
    out.correlation_m = correlation_with_common(kCorrelationM, all_own, all_common);
    found.pad_log = theta[0] + fit.face.pad_log;
    theta += fit.shift + fit.above;
    if (pad > 0) {
      end_at_pad(theta, cells, fit.face.pad_m), end_at_pad(found.own_deviation, cells, fit.face.pad_m);
      for (VectorXd& mode : found.modes) end_at_pad(mode, cells, fit.face.pad_m);
    }
    return found;
  }

  // ln of what the map is to be multiplied with: by the force, else by the pad. Where they contradict each
  // other the modulus may be the other's.
  static double scale(const ModulusInput& in, const ProbeFit& fit, Found& found, ModulusEstimate& out) {
    const double by_force = in.force ? std::log(in.force->force_n / found.force_n) : 0;
    if (!in.tissue.pad) return by_force;
    const StandoffPad& pad = *in.tissue.pad;
    const double by_pad = std::log(pad.youngs_modulus_pa) - found.pad_log, apart = by_force - by_pad;
    if (!in.force) return by_pad;
    const double stated =
                     std::hypot(in.force->deviation(), pad.youngs_modulus_std_pa / pad.youngs_modulus_pa),
                 open = std::hypot(out.model_deviation, out.unstated_deviation, fit.common_log);
    if (std::abs(apart) > kContradictedScale * std::hypot(stated, open)) {
      out.warn(
          ModulusFlag::kScale,
          "by the force the pad has a modulus of {:.3g} kPa, but it is stated as {:.3g}: check the force and "
          "the pad",
          1e-3 * std::exp(by_force + found.pad_log), 1e-3 * pad.youngs_modulus_pa);
      found.modes.push_back(VectorXd::Constant(found.log_modulus.size(), apart));
    }
    return by_force;
  }

  // The probe's force, N, under the push that leaves as much strain as was measured.
  double force_with(const ProbeFit& fit, const VectorXd& theta, double tilt, const VectorXd& observed,
                    const ProbedTissue::Planes& beside) const {
    const auto response = pushed(fit, theta, tilt, beside, true);
    const VectorXd strain = -as_measured(response.axial_strain, fit.tissue->cells(), strain_);
    VectorXd residual = VectorXd::Zero(theta.size());
    for (Index c = 0; c < theta.size(); ++c)
      if (observed[c] > 0 && strain[c] > 0) residual[c] = std::log(strain[c]) - fit.measured.log_strain[c];
    return response.force_n * std::exp(-level_of(residual, observed)) / fit.tissue->force_share();
  }

  void publish(const ModulusInput& in, const ProbeFit& fit, const Found& found, double log_scale,
               ModulusEstimate& out) const {
    const ImageGrid& image = in.measured.grid;
    const CellGrid& cells = fit.tissue->cells();
    out.youngs_modulus.assign(image.size(), std::numeric_limits<float>::quiet_NaN());
    out.log_deviation = out.youngs_modulus;
    for (std::size_t n = 0; n < image.size(); ++n) {
      if (n % image.nx == 0) check_cancelled();
      const double y_m = image.y_m(n) - fit.top_m;
      if (!in.measured.displacement_valid[n] || !std::isfinite(in.measured.axial_strain[n]) ||
          y_m < fit.face.pad_m || y_m > fit.face.image_depth_m)
        continue;
      out.youngs_modulus[n] =
          static_cast<float>(std::exp(at_node(found.log_modulus, cells, image, fit.top_m, n) + log_scale));
      double variance = squared(at_node(found.own_deviation, cells, image, fit.top_m, n));
      for (const VectorXd& mode : found.modes) variance += squared(at_node(mode, cells, image, fit.top_m, n));
      out.log_deviation[n] = static_cast<float>(std::sqrt(variance));
    }
    LogModes& modes = out.log_modes;
    modes.grid = {cells.columns,   cells.rows, cells.first_x_m, fit.top_m + cells.row_m / 2,
                  cells.spacing_m, cells.row_m};
    for (const VectorXd& mode : found.modes)
      for (const double value : mode) modes.values.push_back(static_cast<float>(value));
    normalise(out);
  }

  StrainOptions strain_;
  ProbeFitter fitter_;
};

}  // namespace

std::unique_ptr<ModulusMethod> make_solid(const Queue& queue, const StrainOptions& strain,
                                          std::shared_ptr<StripCache> strips) {
  return std::make_unique<SolidModulusMethod>(queue, strain, std::move(strips));
}

}  // namespace teletact::service
