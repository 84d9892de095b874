#include "service/imaging/modulus/probe_fit.h"

#include <fmt/format.h>

#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <utility>

#include "service/device/look.h"
#include "service/imaging/modulus/modulus.h"
#include "service/imaging/tracking/median.h"

namespace teletact::service {
namespace {

using Eigen::Index;
using Eigen::VectorXd;

constexpr double kNearFieldM = 3e-3;  // what the face's condition decides, not the modulus
constexpr double kTold = 0.4;         // of the median modelled strain: with less a cell tells no modulus
constexpr double kTextureLog = 0.1;   // of ln E of what still looks homogeneous
constexpr int kReweighted = 12;
constexpr double kCorrelatedM2 = 25e-6;  // area over which tissue and model differ alike
constexpr double kBlockRatio = 0.33;     // of lateral strain: more is not tissue that goes on
constexpr double kStandoffM = 4e-3;      // of no echo above the tissue: less is the tracking window's
constexpr double kTrackedFromM = 1e-3;   // depth below the face where tracking begins
constexpr double kUsualElevationM = 0.010, kLogUsualElevation = 0.6;
constexpr double kUsualDepths = 1.5, kLogUsualDepth = 0.4;  // of what the image shows
constexpr double kVary = 0.15, kTiltStep = 0.1;
constexpr double kLeastElevationM = 3e-3, kMostElevationM = 0.040, kMostDepths = 3;
constexpr int kGolden = 5, kRounds = 2;

constexpr double kWellExplained = 0.08;  // of the strain, unexplained: nothing else is tried
constexpr double kBetterBy = 0.7;        // another explanation must leave so much of what is left

// The depth in the image at which the tissue begins, where nothing was tracked above it.
double top_of(const Measured& m) {
  for (std::size_t j = 0; j < m.grid.ny; ++j) {
    std::size_t tracked = 0;
    for (std::size_t i = 0; i < m.grid.nx; ++i) tracked += m.strain_valid[i + m.grid.nx * j];
    if (2 * tracked < m.grid.nx) continue;
    const double y_m = m.grid.y_m(m.grid.nx * j);
    return y_m < kStandoffM ? 0 : y_m - kTrackedFromM;
  }
  throw NoCompression("no depth of the image was tracked over half of its width; press further");
}

double measured_lateral_ratio(const Measured& m) {
  std::vector<float> lateral, axial;
  for (std::size_t n = 0; n < m.grid.size(); ++n)
    if (m.strain_valid[n]) lateral.push_back(m.lateral_strain[n]), axial.push_back(m.axial_strain[n]);
  return axial.empty() ? 0 : -median(lateral) / median(axial);
}

// The least of f over [low, high] by golden sections.
double least(double low, double high, int steps, const auto& f) {
  constexpr double kSection = 0.618;
  double a = high - kSection * (high - low), b = low + kSection * (high - low), fa = f(a), fb = f(b);
  for (int k = 0; k < steps; ++k)
    if (fa < fb)
      high = b, b = a, fb = fa, a = high - kSection * (high - low), fa = f(a);
    else
      low = a, a = b, fa = fb, b = low + kSection * (high - low), fb = f(b);
  return fa < fb ? a : b;
}

double squared(double v) {
  return v * v;
}

// Of ln E of the cells, what one deviation of an unknown changes that was varied by kVary; `usual`: how well
// it is known beforehand.
VectorXd change(const ProbeFit& found, const ProbeFit& varied, double usual) {
  const Index size = found.homogeneous.size();
  VectorXd by = VectorXd::Zero(size);
  if (varied.homogeneous.size() != size) return by;
  double sum = 0, told = 0;
  for (Index c = 0; c < size; ++c) {
    if (!(found.homogeneous[c] > 0 && varied.homogeneous[c] > 0)) continue;
    by[c] = std::log(varied.homogeneous[c] / found.homogeneous[c]) / kVary;
    sum += found.measured.told[c] * by[c], told += found.measured.told[c];
  }
  by.array() -= sum / std::max(told, 1.0);
  const CellGrid& cells = found.tissue->cells();
  const double squares =
      found.measured.told.dot(by.cwiseAbs2()) * cells.spacing_m * cells.row_m / kCorrelatedM2;
  return by / std::sqrt(squares / squared(found.rest) + 1 / squared(usual));
}

}  // namespace

StrainFit fit_strain(const VectorXd& residual, const VectorXd& weight, const VectorXd& by_tilt) {
  std::vector<double> told;
  for (Index c = 0; c < residual.size(); ++c)
    if (weight[c] > 0) told.push_back(residual[c]);
  StrainFit out;
  out.level = median(told), out.rest = kTextureLog;
  Eigen::Matrix2d normal;
  for (int k = 0; k < kReweighted; ++k) {
    // Cauchy's weights: lumps are left out.
    normal.setZero();
    Eigen::Vector2d load = Eigen::Vector2d::Zero();
    std::vector<double> sizes;
    for (Index c = 0; c < residual.size(); ++c) {
      if (!(weight[c] > 0)) continue;
      const double left = residual[c] - out.level + out.tilt * by_tilt[c];
      const double share = 1 / (1 + squared(left / (1.5 * out.rest)));
      const Eigen::Vector2d f(1, -by_tilt[c]);
      normal += share * f * f.transpose(), load += share * residual[c] * f;
      sizes.push_back(std::abs(left));
    }
    const Eigen::Vector2d solution = normal.fullPivLu().solve(load);
    out.level = solution[0], out.tilt = solution[1];
    out.rest = std::max(1.48 * median(sizes), 0.02);
  }
  const double variance = normal.inverse()(1, 1);
  out.tilt_deviation = out.rest * std::sqrt(std::max(0.0, variance));
  return out;
}

ProbeFitter::ProbeFitter(const Queue& queue, const StrainOptions& strain) : queue_(queue), strain_(strain) {}

const ProbeFitter::Kept& ProbeFitter::kept(const ProbeFace& face, bool block) {
  if (kept_ && kept_->face == face && kept_->block == block) return *kept_;
  kept_.reset();
  Kept made{face, block, block ? make_probed_block(face) : make_probed_solid(queue_, face), {}, {}};
  look();
  made.level = made.tissue->push_homogeneous();
  made.tilted = made.tissue->push_homogeneous(kTiltStep);
  kept_ = std::move(made);
  return *kept_;
}

ProbeFit ProbeFitter::tried(const Pair& pair, const ProbeFace& face, bool block) {
  look();
  ProbeFit out;
  const Kept& kept = this->kept(face, block);
  out.tissue = kept.tissue, out.face = face, out.top_m = pair.top_m;
  const CellGrid& cells = out.tissue->cells();
  out.measured = cell_strains(pair.measured, cells, pair.top_m, pair.sign);
  out.homogeneous = -as_measured(kept.level.axial_strain, cells, strain_);
  out.by_tilt = -as_measured(kept.tilted.axial_strain, cells, strain_);
  std::vector<double> strained, ratios;
  for (Index c = 0; c < out.homogeneous.size(); ++c)
    if (out.homogeneous[c] > 0) strained.push_back(out.homogeneous[c]);
  const double typical = median(strained);
  VectorXd residual = VectorXd::Zero(out.homogeneous.size());
  for (Index c = 0; c < out.homogeneous.size(); ++c) {
    double& told = out.measured.told[c];
    if (cells.y_m(static_cast<std::size_t>(c)) < kNearFieldM || out.homogeneous[c] < kTold * typical)
      told = 0;
    out.by_tilt[c] = out.homogeneous[c] > 0 ? (out.by_tilt[c] / out.homogeneous[c] - 1) / kTiltStep : 0;
    if (!(told > 0)) continue;
    residual[c] = std::log(out.homogeneous[c]) - out.measured.log_strain[c];
    ratios.push_back(-kept.level.lateral_strain[c] / kept.level.axial_strain[c]);
  }
  if (ratios.empty())
    throw NoCompression("no cell of the strain map tells a modulus; press further between the frames");
  out.lateral_ratio = median(ratios);
  out.rest = fit_strain(residual, out.measured.told, out.by_tilt).rest;
  return out;
}

// What is fitted: ln of the face's length across the image, and of the tissue's depth.
struct ProbeFitter::Unknown {
  bool elevation, depth;
  double log_elevation, log_depth;
  ProbeFace face;  // what is known
  ProbeFace at(double e, double h) const {
    ProbeFace out = face;
    if (elevation) out.elevation_m = std::exp(e);
    if (depth) out.depth_m = std::exp(h);
    return out;
  }
};

// The least of what is left, by golden sections along one unknown and the other.
void ProbeFitter::search(const Pair& pair, Unknown& u) {
  const double usual_depth = u.log_depth, usual_elevation = u.log_elevation;
  // Half squares of what is left, over as many as are independent, and of what is unusual.
  const auto cost = [&](double e, double h) {
    const ProbeFit fit = tried(pair, u.at(e, h), false);
    const CellGrid& cells = fit.tissue->cells();
    const double independent = fit.measured.told.sum() * cells.spacing_m * cells.row_m / kCorrelatedM2;
    return independent * std::log(fit.rest) + squared((e - usual_elevation) / kLogUsualElevation) / 2 +
           squared((h - usual_depth) / kLogUsualDepth) / 2;
  };
  const double image_m = u.face.image_depth_m;
  for (int round = 0; round < kRounds && (u.elevation || u.depth); ++round) {
    if (u.elevation)
      u.log_elevation = least(std::log(kLeastElevationM), std::log(kMostElevationM), kGolden,
                              [&](double e) { return cost(e, u.log_depth); });
    if (u.depth)
      u.log_depth = least(std::log(image_m), std::log(kMostDepths * image_m), kGolden,
                          [&](double h) { return cost(u.log_elevation, h); });
  }
}

ProbeFit ProbeFitter::fit(const Measured& m, double window_width_m, const TissueExtent& tissue,
                          double elevation_m, double sign) {
  const Pair pair{m, top_of(m), sign};
  const double image_m = m.grid.y_m(m.grid.size() - 1) + m.grid.dy_m / 2 - pair.top_m;
  Unknown u{!(elevation_m > 0),
            !tissue.depth_stated,
            std::log(kUsualElevationM),
            std::log(kUsualDepths * image_m),
            {window_width_m, elevation_m, tissue.depth_m - pair.top_m, image_m, tissue.poisson_ratio}};
  search(pair, u);
  ProbeFit out = tried(pair, u.at(u.log_elevation, u.log_depth), false);
  if (!u.depth && out.rest > kWellExplained) {  // is it as deep as stated?
    Unknown deeper = u;
    deeper.depth = true;
    search(pair, deeper);
    ProbeFit other = tried(pair, deeper.at(deeper.log_elevation, deeper.log_depth), false);
    if (other.rest < kBetterBy * out.rest) u = deeper, out = std::move(other);
  }
  const ProbeFace found = u.at(u.log_elevation, u.log_depth);
  const auto vary = [&](double by_e, double by_h, double usual) {
    out.changes.push_back(
        change(out, tried(pair, u.at(u.log_elevation + by_e, u.log_depth + by_h), false), usual));
  };
  if (u.elevation) vary(kVary, 0, kLogUsualElevation);
  if (u.depth) vary(0, kVary, kLogUsualDepth);
  const auto origin = [](bool fitted) { return fitted ? "fitted" : "stated"; };
  out.words = fmt::format(
      "solid tissue {:.0f} mm deep ({}) under a face of {:.1f} x {:.1f} mm ({}): {:.0f} % of the strain "
      "unexplained where it is homogeneous",
      1e3 * found.depth_m, origin(u.depth), 1e3 * found.width_m, 1e3 * found.elevation_m, origin(u.elevation),
      100 * out.rest);
  if (out.rest > kWellExplained) {
    const double ratio = measured_lateral_ratio(m);
    ProbeFit block = tried(pair, found, true);
    if (block.rest < (ratio > kBlockRatio ? 1 : kBetterBy) * out.rest) {
      block.words = fmt::format(
          "a block as wide as the probe: a uniform strain leaves {:.0f} % of it unexplained, tissue that "
          "goes "
          "on beside the probe {:.0f} %; it spreads sideways by {:.2f} of its axial strain",
          100 * block.rest, 100 * out.rest, ratio);
      out = std::move(block);
    }
  }
  if (pair.top_m > 0)
    out.words += fmt::format("; the tissue is taken to begin {:.1f} mm deep", 1e3 * pair.top_m);
  return out;
}

}  // namespace teletact::service
