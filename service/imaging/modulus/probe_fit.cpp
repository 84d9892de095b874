#include "service/imaging/modulus/probe_fit.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <stdexcept>
#include <utility>

#include "service/device/cancellation.h"
#include "service/imaging/modulus/modulus.h"
#include "service/imaging/tracking/median.h"

namespace teletact::service {
namespace {

using Eigen::Index;
using Eigen::VectorXd;

constexpr double kNearFieldM = 3e-3;  // what the face's condition decides, not the modulus
constexpr double kTold = 0.4;         // of the median modelled strain: with less a cell tells no modulus
constexpr double kBlockRatio = 0.33;  // of lateral strain: more is not tissue that goes on
constexpr double kStandoffM = 4e-3;   // of the image without a trusted strain: less is the kernels'
// Where tissue that ends is taken to end beside the probe, in depths of it.
constexpr double kFarDepths = 0.7, kNearDepths = 0.3;
constexpr double kCommonLog = 0.04, kCommonLogOfSides = 0.06;  // of tissue that goes on, and that ends
constexpr double kDeepestBlockM = 0.4;                         // of an image
constexpr double kTrackedFromM = 1e-3;                         // depth below the face where tracking begins
constexpr double kUsualElevationM = 0.010, kLogUsualElevation = 0.6;
constexpr double kUsualDepths = 1.5, kLogUsualDepth = 0.4;  // of what the image shows
constexpr double kMaxTiltOfSides = 0.2;  // of the push, to an end of the face: with more none are tried
constexpr double kVary = 0.15, kTiltStep = 0.1;
constexpr double kMinElevationM = 3e-3, kMaxElevationM = 0.040, kMaxDepths = 3;
constexpr int kGolden = 5, kTried = 2 + kGolden, kRounds = 2;

constexpr double kWellExplained = 0.08;  // of the strain, unexplained: nothing else is tried
constexpr double kBetterBy = 0.7;        // another explanation must leave so much of what is left
constexpr double kSidesBetterBy = 0.85;  // of a hundred places that differ: ln of the odds is 16
constexpr double kGradedBetterBy = 0.85;
// Change of ln E from the face to the bottom of the image: less is not worth a word, more is no tissue.
constexpr double kNotedGrading = 0.2, kMaxGrading = 1.1;
constexpr double kNoWorse = 1.25;  // what leaves so much of the strain may as well be true
// Standard deviation of ln E where other explanations were not tried: tissue that ends 0.5 to 0.75 depths
// beside the probe reads 0.79 to 0.89 of the truth, what ends nearer less.
constexpr double kUndoubtedLog = 0.3;

// The depth at which the tissue begins, where what the image shows above it was not tracked.
double top_of(const Measured& m) {
  for (std::size_t j = 0; j < m.grid.ny; ++j) {
    std::size_t tracked = 0;
    for (std::size_t i = 0; i < m.grid.nx; ++i) tracked += m.strain_valid[i + m.grid.nx * j];
    if (2 * tracked < m.grid.nx) continue;
    const double y_m = m.grid.y_m(m.grid.nx * j);
    return y_m - std::max(m.grid.origin_y_m, 0.0) < kStandoffM ? 0 : y_m - kTrackedFromM;
  }
  throw NoCompression("no depth of the image was tracked over half of its width; press further");
}

// The unexplained part of the strain, where the modulus may change with depth as it does in tissue.
double left(const ProbeFit& fit) {
  return std::abs(fit.grading) < kMaxGrading ? std::min(fit.rest, fit.graded_rest / kGradedBetterBy)
                                             : fit.rest;
}

// ln E of homogeneous tissue that bears 1 N so and strains as was measured.
double log_scale(const ProbeFit& fit) {
  return fit.level - std::log(fit.force_n / fit.tissue->force_share());
}

// Where f was least over [low, high], by golden sections; `usual` where it was nowhere finite.
double least(double low, double high, int steps, double usual, const auto& f) {
  constexpr double kSection = 0.618;
  double at = usual, found = HUGE_VAL;
  const auto value = [&](double x) {
    const double v = f(x);
    if (v < found) at = x, found = v;
    return v;
  };
  double a = high - kSection * (high - low), b = low + kSection * (high - low), fa = value(a), fb = value(b);
  for (int k = 0; k < steps; ++k)
    if (fa < fb)
      high = b, b = a, fb = fa, a = high - kSection * (high - low), fa = value(a);
    else
      low = a, a = b, fa = fb, b = low + kSection * (high - low), fb = value(b);
  return at;
}

// The change of ln E of the cells by one deviation of an unknown that was varied by kVary; `usual`: how well
// it is known beforehand; `fitted`: and since. An absolute modulus changes as the strain that goes with a
// force does, a relative one as the strain beside its mean.
VectorXd change(const ProbeFit& found, const ProbeFit& varied, double usual, bool fitted, bool absolute) {
  const Index size = found.homogeneous.size();
  VectorXd by = VectorXd::Zero(size);
  if (varied.homogeneous.size() != size) return by;
  double sum = 0, observed = 0;
  for (Index c = 0; c < size; ++c) {
    if (!(found.homogeneous[c] > 0 && varied.homogeneous[c] > 0)) continue;
    by[c] = std::log(varied.homogeneous[c] / found.homogeneous[c]) / kVary;
    sum += found.measured.observed[c] * by[c], observed += found.measured.observed[c];
  }
  const double mean = sum / std::max(observed, 1.0),
               of_force = std::log(varied.force_n / found.force_n) / kVary;
  const CellGrid& cells = found.tissue->cells();
  const double squares = found.measured.observed.dot((by.array() - mean).square().matrix()) *
                         cells.spacing_m * cells.row_m / kAlikeM2;
  by.array() -= absolute ? of_force : mean;
  return by / std::sqrt((fitted ? squares / squared(found.rest) : 0) + 1 / squared(usual));
}

std::string words_of_sides(const ProbeFace& face) {
  if (face.goes_on()) return "";
  const std::string end = face.beside_m > 0
                              ? fmt::format("it ends some {:.0f} mm beside the probe", 1e3 * face.beside_m)
                              : "it is as wide as the probe";
  return fmt::format("; {}, as the strain shows{}", end, face.slides ? ", and slides on its support" : "");
}

// Empty where the modulus changes little, or that explains nothing.
std::string words_of_grading(const ProbeFit& fit) {
  if (std::abs(fit.grading) < kNotedGrading || !(left(fit) < fit.rest)) return "";
  return fmt::format(
      "; its modulus {} by {:.1f} from the face to the bottom of the image, as the strain shows",
      fit.grading < 0 ? "falls" : "rises", std::exp(std::abs(fit.grading)));
}

}  // namespace

ProbeFitter::ProbeFitter(const Queue& queue, const StrainOptions& strain, std::shared_ptr<StripCache> strips)
    : queue_(queue), strain_(strain), strips_(std::move(strips)) {}

ProbeFitter::Kept& ProbeFitter::kept(const ProbeFace& face, bool block) {
  if (kept_ && kept_->face == face && kept_->block == block) return *kept_;
  kept_.reset();
  Kept made{face, block, block ? make_probed_block(face, *strips_) : make_probed_solid(queue_, face), {}, {}};
  check_cancelled();
  ++solves_, made.level = made.tissue->push_homogeneous();
  kept_ = std::move(made);
  return *kept_;
}

ProbeFit ProbeFitter::tried(const Pair& pair, const ProbeFace& face, const VectorXd* by_tilt, bool block) {
  check_cancelled();
  ProbeFit out;
  Kept& kept = this->kept(face, block);
  out.tissue = kept.tissue, out.face = face, out.top_m = pair.top_m;
  const CellGrid& cells = out.tissue->cells();
  out.measured = cell_strains(pair.measured, cells, pair.top_m, pair.sign);
  out.homogeneous = -as_measured(kept.level.axial_strain, cells, strain_);
  const bool alike = by_tilt && by_tilt->size() == out.homogeneous.size();
  if (!alike && !kept.tilted) ++solves_, kept.tilted = out.tissue->push_homogeneous(kTiltStep);
  out.by_tilt = alike ? *by_tilt : VectorXd(-as_measured(kept.tilted->axial_strain, cells, strain_));
  std::vector<double> strained, ratios;
  for (Index c = 0; c < out.homogeneous.size(); ++c)
    if (out.homogeneous[c] > 0) strained.push_back(out.homogeneous[c]);
  const double typical = median(strained);
  VectorXd residual = VectorXd::Zero(out.homogeneous.size());
  for (Index c = 0; c < out.homogeneous.size(); ++c) {
    double& observed = out.measured.observed[c];
    if (cells.y_m(static_cast<std::size_t>(c)) < kNearFieldM || out.homogeneous[c] < kTold * typical)
      observed = 0;
    if (!alike)
      out.by_tilt[c] = out.homogeneous[c] > 0 ? (out.by_tilt[c] / out.homogeneous[c] - 1) / kTiltStep : 0;
    if (!(observed > 0)) continue;
    residual[c] = std::log(out.homogeneous[c]) - out.measured.log_strain[c];
    ratios.push_back(-kept.level.lateral_strain[c] / kept.level.axial_strain[c]);
  }
  if (ratios.empty())
    throw NoCompression("no cell of the strain map tells a modulus; press further between the frames");
  out.lateral_ratio = median(ratios), out.force_n = kept.level.force_n;
  out.common_log = block || face.goes_on() ? kCommonLog : kCommonLogOfSides;
  const StrainFit strain = fit_strain(residual, out.measured.observed, out.by_tilt);
  out.rest = strain.rest, out.tilt = strain.tilt;
  VectorXd depth(residual.size());  // in images, from the middle of one
  for (Index c = 0; c < depth.size(); ++c)
    depth[c] = cells.y_m(static_cast<std::size_t>(c)) / face.image_depth_m - 0.5;
  const StrainFit graded = fit_strain(residual, out.measured.observed, out.by_tilt, depth);
  out.grading = graded.grading, out.graded_rest = graded.rest;
  out.level = strain.level;
  return out;
}

// The unknowns: ln of the face's length across the image, and of the tissue's depth.
struct ProbeFitter::Unknown {
  bool elevation, depth;
  double log_elevation, log_depth;
  ProbeFace face;  // what is known
  ProbeFace at() const { return at(log_elevation, log_depth); }
  ProbeFace at(double e, double h) const {
    ProbeFace out = face;
    if (elevation) out.elevation_m = std::exp(e);
    if (depth) out.depth_m = std::exp(h);
    return out;
  }
};

// The least of what is left, by golden sections along one unknown and the other.
void ProbeFitter::search(const Pair& pair, Unknown& u, int rounds) {
  const double image_m = u.face.image_depth_m;
  // Half squares of what is left, over as many places of the image as differ, and of what is unusual.
  const double differ = u.face.width_m * image_m / kAlikeM2;
  VectorXd by_tilt;  // of the first: of the others it is nearly the same
  const auto cost = [&](double e, double h) {
    try {
      const ProbeFit at = tried(pair, u.at(e, h), &by_tilt);
      by_tilt = at.by_tilt;
      return differ * std::log(at.rest) + squared((e - std::log(kUsualElevationM)) / kLogUsualElevation) / 2 +
             squared((h - std::log(kUsualDepths * image_m)) / kLogUsualDepth) / 2;
    } catch (const std::invalid_argument&) {
      return HUGE_VAL;  // beyond what is modelled
    }
  };
  if (!(u.elevation && u.depth)) rounds = u.elevation || u.depth;
  for (int round = 0; round < rounds; ++round) {
    if (u.elevation)
      u.log_elevation = least(std::log(kMinElevationM), std::log(kMaxElevationM), kGolden, u.log_elevation,
                              [&](double e) { return cost(e, u.log_depth); });
    if (u.depth)
      u.log_depth = least(std::log(image_m), std::log(kMaxDepths * image_m), kGolden, u.log_depth,
                          [&](double h) { return cost(u.log_elevation, h); });
  }
}

// Deeper than stated, a block, or with sides: what explains the strain better. What explains it no worse and
// would bear the force by another modulus widens what is stated.
void ProbeFitter::doubt(const Pair& pair, Unknown& u, ProbeFit& out, const ModulusInput& in) {
  std::vector<Rival> rivals{{left(out), log_scale(out)}};
  try_others(pair, u, out, rivals);
  if (!in.force) return;
  double apart = 0;
  for (const Rival& r : rivals)
    if (r.left < kNoWorse * left(out)) apart = std::max(apart, std::abs(r.log_scale - log_scale(out)));
  out.common_log = std::hypot(out.common_log, apart);
}

void ProbeFitter::try_others(const Pair& pair, Unknown& u, ProbeFit& out, std::vector<Rival>& rivals) {
  const Unknown stated = u;
  const auto to_beat = [&] { return stated.depth ? out.rest : left(out); };
  const auto considered = [&](const ProbeFit& other) {
    rivals.push_back({left(other), log_scale(other)});
    return other.rest;
  };
  // A face that touches in part looks tilted, and sides would explain some of it.
  const bool tilted = std::abs(out.tilt) > kMaxTiltOfSides;
  if (!u.depth) {
    Unknown deeper = u;
    deeper.depth = true;
    search(pair, deeper, 1);
    ProbeFit other = tried(pair, deeper.at());
    // Its own modulus may change with depth as well.
    if (considered(other) < kBetterBy * out.rest && left(other) < kBetterBy * left(out))
      u = deeper, out = std::move(other);
  }
  if (stated.face.image_depth_m < kDeepestBlockM) {
    ProbeFace as_wide = out.face;
    as_wide.beside_m = 0;
    const double ratio = lateral_ratio(pair.measured).value_or(0);
    ProbeFit block = tried(pair, as_wide, nullptr, true);
    if (considered(block) < (ratio > kBlockRatio ? 1 : kBetterBy) * to_beat()) {
      block.words = fmt::format(
          "a block as wide as the probe: a uniform strain leaves {:.0f} % of it unexplained, tissue that "
          "goes on beside the probe {:.0f} %; it spreads sideways by {:.2f} of its axial strain",
          100 * block.rest, 100 * out.rest, ratio);
      out = std::move(block);
    }
  }
  if (tilted) return;
  const ProbeFace usual = stated.at();
  struct Sides {
    double depths;
    bool slides;
  };
  bool ends = false;
  VectorXd by_tilt;  // of the first: of the others it is nearly the same
  for (const Sides& sides : {Sides{kFarDepths, false}, Sides{kFarDepths, true}, Sides{kNearDepths, false},
                             Sides{kNearDepths, true}, Sides{0, false}}) {
    if (stated.depth && sides.depths == kNearDepths) continue;  // a depth that is too large looks like that
    Unknown other = stated;
    other.face.beside_m = sides.depths * usual.depth_m, other.face.slides = sides.slides;
    try {
      ProbeFit found = tried(pair, other.at(), &by_tilt);
      by_tilt = found.by_tilt;
      double share = ends ? 1 : kSidesBetterBy;
      // The block's depth is not seen: where it is stated the solid is the likelier of the two.
      if (!ends && !out.words.empty() && sides.depths == 0 && !stated.depth) share = 1 / kSidesBetterBy;
      if (!(considered(found) < share * (ends ? out.rest : to_beat()))) continue;
      ends = true, u = other, out = std::move(found);
    } catch (const std::invalid_argument&) {  // beyond what is modelled
    }
  }
  if (!ends || !(u.elevation || u.depth)) return;
  Unknown again = u;
  search(pair, again, 1);
  if (ProbeFit other = tried(pair, again.at()); other.rest < out.rest) u = again, out = std::move(other);
}

int ProbeFitter::max_solves(const ModulusInput& in, double elevation_m, FitEffort effort) {
  const int depth = !in.tissue.depth_stated, elevation = !(elevation_m > 0);
  constexpr int kOne = 2;  // level and tilted
  // Tissue that ends has other cells for each depth: no tilt serves two.
  const auto searched = [](int unknowns, int rounds, int each) {
    return unknowns == 0 ? 0 : 1 + rounds * unknowns * kTried * each;
  };
  const int varied = kOne * 2 * (elevation + depth);  // the one way or the other
  const int usual = kOne + varied,
            fitted = usual + searched(elevation + depth, elevation + depth == 2 ? kRounds : 1, 1);
  if (effort == FitEffort::kUsual) return usual;
  if (effort == FitEffort::kFitted) return fitted;
  constexpr int kBlock = kOne, kSides = 5 * kOne;
  const int deeper = depth ? 0 : searched(elevation + 1, 1, 1) + kOne,
            again = searched(elevation + depth, 1, kOne) + kOne;
  return fitted + deeper + kBlock + kSides + again;
}

ProbeFit ProbeFitter::fit(const ModulusInput& in, double elevation_m, double sign, FitEffort effort) {
  solves_ = 0;
  const Measured& m = in.measured;
  const Pair pair{m, top_of(m), sign};
  const double image_m = m.grid.y_m(m.grid.size() - 1) + m.grid.dy_m / 2 - pair.top_m;
  if (!(in.tissue.depth_m > pair.top_m))
    throw std::invalid_argument(
        fmt::format("tissue_depth_m: the tissue ends {:.1f} mm deep, but nothing was tracked above {:.1f} mm",
                    1e3 * in.tissue.depth_m, 1e3 * pair.top_m));
  Unknown u{
      !(elevation_m > 0),
      !in.tissue.depth_stated,
      std::log(kUsualElevationM),
      std::log(kUsualDepths * image_m),
      {in.window_width_m, elevation_m, in.tissue.depth_m - pair.top_m, image_m, in.tissue.poisson_ratio}};
  if (effort != FitEffort::kUsual) search(pair, u, kRounds);
  ProbeFit out = tried(pair, u.at());
  const bool doubtful = out.rest > kWellExplained, doubted = doubtful && effort == FitEffort::kDoubted;
  if (doubted) doubt(pair, u, out, in);
  // Sides may look like it: it counts where all was tried.
  const std::string grading = doubted ? words_of_grading(out) : "";
  if (!grading.empty()) out.rest = out.graded_rest;
  out.undoubted = doubtful && !doubted;
  if (out.undoubted) out.common_log = std::hypot(out.common_log, kUndoubtedLog);
  out.as_usual = effort == FitEffort::kUsual && (u.elevation || u.depth);
  if (out.words.empty()) {
    // The one way or the other: it may stand at the edge of what is modelled.
    const auto vary = [&](double by_e, double by_h, double usual) {
      const auto changed = [&](double way) {
        const ProbeFace varied = u.at(u.log_elevation + way * by_e, u.log_depth + way * by_h);
        return change(out, tried(pair, varied, &out.by_tilt), usual, !out.as_usual, in.force.has_value());
      };
      try {
        out.changes.push_back(changed(1));
      } catch (const std::invalid_argument&) {
        out.changes.push_back(changed(-1));
      }
    };
    if (u.elevation) vary(kVary, 0, kLogUsualElevation);
    if (u.depth) vary(0, kVary, kLogUsualDepth);
    const auto origin = [&out](bool unknown) {
      return !unknown ? "stated" : out.as_usual ? "usual" : "fitted";
    };
    out.words = fmt::format(
        "solid tissue {:.0f} mm deep ({}{}) under a face of {:.1f} x {:.1f} mm ({}): {:.0f} % of the strain "
        "unexplained where it is homogeneous",
        1e3 * out.face.depth_m, origin(u.depth), words_of_sides(out.face), 1e3 * out.face.width_m,
        1e3 * out.face.elevation_m, origin(u.elevation), 100 * out.rest);
  }
  out.words += grading;
  if (pair.top_m > 0)
    out.words += fmt::format("; the tissue is taken to begin {:.1f} mm deep", 1e3 * pair.top_m);
  out.solves = solves_;
  return out;
}

}  // namespace teletact::service
