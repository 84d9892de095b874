// A tissue that may lie under a probe fitted to the strain, and where that fit leads.
#include <algorithm>
#include <array>
#include <cmath>
#include <vector>

#include "service/base/squared.h"
#include "service/imaging/modulus/pad.h"
#include "service/imaging/modulus/weighed_tissues.h"

namespace teletact::service {
namespace {

using Eigen::Index;
using Eigen::VectorXd;

constexpr double kUsualGrading = 0.12;  // of ln E from the face to the bottom of the image, beforehand
constexpr double kUsualPad = 0.5;       // of ln of a pad's modulus over the tissue's, about the first guess
constexpr double kLateralRatio = 0.1;   // deviation of - lateral over axial strain, model and measured

VectorXd residual_of(const TissueWindow& w, const CandidateTissue& m) {
  VectorXd residual = m.answer->log_strain - w.measured.log_strain;
  if (!m.block) residual += w.finer;
  return residual;
}

std::vector<FitColumn> columns_of(const TissueWindow& w, const CandidateTissue& m) {
  std::vector<FitColumn> columns{{-w.by_tilt, 0, kUsualTilt, false}};
  // Sides may look like a grading: it counts where they are tried.
  if (!w.as_stated) columns.push_back({w.of_depth, 0, kUsualGrading, true});
  if (!m.block && !w.as_stated) {
    const auto known = [&](const KnownLength& of, const VectorXd& by, double at_m) {
      columns.push_back({-by, of.log - std::log(at_m), of.deviation, of.stated, kLinear});
    };
    known(w.elevation, m.by_elevation.strain, m.face.elevation_m);
    known(w.depth, m.by_depth.strain, m.face.depth_m);
    if (m.by_beside.size()) columns.push_back({-m.by_beside, 0, kOfGridStep, false});
  }
  if (w.face.pad_m > 0) {
    if (!m.block && !w.as_stated)
      columns.push_back({-w.by_pad_thickness.strain, w.pad.log - std::log(m.face.pad_m), w.pad.deviation,
                         w.pad.stated, kLinear});
    columns.push_back({-w.by_pad_modulus, w.pad_log - m.face.pad_log, kUsualPad, false});
  }
  return columns;
}

}  // namespace

double within_place(const CandidateTissue& m, double beside_m) {
  return std::clamp(beside_m, std::max(0.0, m.place_m - m.step_m / 2), m.place_m + m.step_m / 2);
}

void TissueWeigher::fit(const TissueWindow& w, CandidateTissue& m, double scale) const {
  m.fit = fit_robustly(residual_of(w, m), w.measured.observed, columns_of(w, m), w.places, scale);
  if (std::isfinite(w.lateral_ratio))
    m.fit.misfit += std::log1p(squared((w.lateral_ratio - m.answer->lateral_ratio) / kLateralRatio) / 2);
}

void TissueWeigher::fit_skin(const TissueWindow& w, CandidateTissue& m, double scale) const {
  if (m.block || m.face.pad_m > 0 || m.face.beside_m < kSkinBeside * m.face.depth_m) return;
  std::vector<FitColumn> columns = columns_of(w, m);
  for (std::size_t k = 0; k < kSkinChanges; ++k)
    columns.push_back({-w.by_skin.log_strain[k], w.skin.mean[k], w.skin.deviation[k], true});
  m.with_skin = fit_robustly(residual_of(w, m), w.measured.observed, columns, w.places, scale);
}

ProbeFace led_to(const TissueWindow& w, const CandidateTissue& m, const RobustFit& fit) {
  ProbeFace face = m.face;
  const auto moved = [](const KnownLength& of, double at_m, double by) {
    return std::exp(std::clamp(std::log(at_m) + by, of.low, of.high));
  };
  face.elevation_m = moved(w.elevation, face.elevation_m, fit.at[kElevation]);
  face.depth_m = moved(w.depth, face.depth_m, fit.at[kDepth]);
  if (face.pad_m > 0) {
    face.pad_m = moved(w.pad, face.pad_m, fit.at[pad_column(fit)]);
    face.pad_log = std::clamp(face.pad_log + fit.at[pad_column(fit) + 1], -kMostPadLog, kMostPadLog);
  }
  if (m.by_beside.size()) face.beside_m = within_place(m, face.beside_m + m.step_m * fit.at[kBeside]);
  return face;
}

double way_to(const ProbeFace& face, const CandidateTissue& m) {
  return std::max({std::abs(std::log(face.elevation_m / m.face.elevation_m)),
                   std::abs(std::log(face.depth_m / m.face.depth_m)), std::abs(face.pad_log - m.face.pad_log),
                   face.pad_m > 0 ? std::abs(std::log(face.pad_m / m.face.pad_m)) : 0.0,
                   m.step_m > 0 ? 0.5 * std::abs(face.beside_m - m.face.beside_m) / m.step_m : 0.0});
}

std::array<int, 2> kind_of(const CandidateTissue& m) {
  return {m.block ? 3 : m.face.goes_on() ? 0 : m.face.beside_m > 0 ? 1 : 2, m.face.slides};
}

}  // namespace teletact::service
