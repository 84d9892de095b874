#include "service/imaging/modulus/probe_fit.h"

#include <fmt/format.h>
#include <Eigen/Cholesky>

#include <algorithm>
#include <array>
#include <cmath>
#include <map>
#include <stdexcept>
#include <utility>

#include "service/device/cancellation.h"
#include "service/imaging/modulus/modulus.h"
#include "service/imaging/modulus/robust_fit.h"
#include "service/imaging/tracking/median.h"

namespace teletact::service {
namespace {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;

constexpr double kNearFieldM = 3e-3;   // what the face's condition decides, not the modulus
constexpr double kTold = 0.4;          // of the median modelled strain: with less a cell tells no modulus
constexpr double kLeastStrain = 0.02;  // of it, that a model shows anywhere: what has less is a lump to it
constexpr double kStandoffM = 4e-3;    // of the image without a trusted strain: less is the kernels'
constexpr double kCommonLog = 0.04, kCommonLogOfSides = 0.06;  // of tissue that goes on, and that ends
constexpr double kDeepestBlockM = 0.4;                         // of an image
constexpr double kTrackedFromM = 1e-3;                         // depth below the face where tracking begins

// Beforehand: ln of what is not stated, about the usual; ln of what is stated, without a deviation of its
// own; ln E from the face to the bottom of the image.
constexpr double kUsualElevationM = 0.010, kLogUsualElevation = 0.6;
constexpr double kUsualDepths = 1.5, kLogUsualDepth = 0.4;  // of what the image shows
constexpr double kLogStated = 0.1;
constexpr double kUsualGrading = 0.12;
// What the tissue may be. Where it may end beside the probe, in depths: the next to a place is as likely.
constexpr std::array kBesideDepths{0.0, 0.1, 0.2, 0.35, 0.5, 0.7};
constexpr double kGoesOn = 0.5, kSlides = 0.3, kIsBlock = 0.05;  // beforehand: shares of all, of each, of all
constexpr double kBesideAsStated = 0.9, kAsWideM = 0.5e-3;
constexpr double kOfGridStep = 0.3;  // deviation of where it ends, in steps between the places

constexpr double kVary = 0.15, kTiltStep = 0.1;
constexpr double kMinElevationM = 3e-3, kMaxElevationM = 0.040, kMaxDepths = 3;
constexpr double kLinear = 0.15;  // of ln of elevation and depth: as far as a step is true, about
constexpr double kSettled = 0.1;  // of ln of elevation and depth: what is linear enough
constexpr int kRounds = 3, kRoundsOfOthers = 2;
constexpr double kWorthless = 5;         // ln of the odds against a model that is not looked at closer
constexpr double kLeastWeight = 0.01;    // of a model that counts
constexpr double kLateralRatio = 0.1;    // deviation of - lateral over axial strain, model and measured
constexpr double kMaxTiltOfSides = 0.2;  // of the push, to an end of the face: with more none are tried
constexpr int kCoarsePerSolve = 4;       // solves of coarse tissue that take as long as a fine one

constexpr double kFarFromStated = 3, kContradicted = 2;  // deviations of what is stated
// Of ln E where the strain contradicts what is stated: a face that is stated 75 % too long puts it off by up
// to 0.26.
constexpr double kContradictedLog = 0.15;
constexpr double kSure = 0.9;            // weight: no other tissue is named
constexpr double kSpreadOfDepth = 0.29;  // deviation of the cells' depth, in images

constexpr double kWellExplained = 0.08;  // of the strain, unexplained
// Standard deviation of ln E where other tissue was not tried: tissue that ends 0.5 to 0.75 depths beside
// the probe reads 0.79 to 0.89 of the truth, what ends nearer less.
constexpr double kUnweighedLog = 0.3;
// Change of ln E from the face to the bottom of the image: less is not worth a word, more is no tissue.
constexpr double kNotedGrading = 0.2, kMaxGrading = 1.1;

enum Column { kTilt, kGrading, kElevation, kDepth, kBeside };

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

// What is known of ln of a length beforehand.
struct Known {
  bool stated;
  double log, deviation, low, high;
  bool contradicted(double at_m) const {
    return stated && std::abs(std::log(at_m) - log) > kContradicted * deviation;
  }
};

Known elevation_known(const TissueExtent& tissue, double elevation_m) {
  const double low = std::log(kMinElevationM), high = std::log(kMaxElevationM);
  if (!(elevation_m > 0)) return {false, std::log(kUsualElevationM), kLogUsualElevation, low, high};
  const double std_m = tissue.probe_elevation_std_m, log = std::log(elevation_m);
  return {true, log, std_m > 0 ? std_m / elevation_m : kLogStated, std::min(low, log), std::max(high, log)};
}

Known depth_known(const TissueExtent& tissue, double depth_m, double image_m) {
  const double low = std::log(image_m), high = std::log(kMaxDepths * image_m);
  if (!tissue.depth_stated) return {false, std::log(kUsualDepths * image_m), kLogUsualDepth, low, high};
  const double log = std::log(depth_m);
  return {true, log, tissue.depth_std_m > 0 ? tissue.depth_std_m / depth_m : kLogStated, std::min(low, log),
          std::max(high, log)};
}

// Over what area what is left of a fit is alike: the integral of its autocorrelation while that is above 0,
// lumps limited to two scales.
double alike_m2(const VectorXd& left, const CellGrid& cells, double scale) {
  constexpr Index kReach = 5;  // cells
  const auto columns = static_cast<Index>(cells.columns), rows = static_cast<Index>(cells.rows);
  const VectorXd limited = left.cwiseMax(-2 * scale).cwiseMin(2 * scale);
  double sum = 0;
  for (Index j = -kReach; j <= kReach; ++j)
    for (Index i = -kReach; i <= kReach; ++i) {
      double products = 0;
      for (Index b = std::max<Index>(0, -j); b < std::min(rows, rows - j); ++b)
        for (Index a = std::max<Index>(0, -i); a < std::min(columns, columns - i); ++a)
          products += limited[a + columns * b] * limited[a + i + columns * (b + j)];
      sum += std::max(0.0, products / limited.squaredNorm());
    }
  return std::max(kAlikeM2, sum * cells.spacing_m * cells.row_m);
}

// Cells that tell no modulus: near the face, and where homogeneous tissue hardly strains.
void leave_out(const VectorXd& log_strain, const CellGrid& cells, VectorXd& observed) {
  std::vector<double> values(log_strain.begin(), log_strain.end());
  const double told = std::log(kTold) + median(values);
  for (Index c = 0; c < observed.size(); ++c)
    if (cells.y_m(static_cast<std::size_t>(c)) < kNearFieldM || log_strain[c] < told) observed[c] = 0;
  if (!(observed.maxCoeff() > 0))
    throw NoCompression("no cell of the strain map tells a modulus; press further between the frames");
}

// A field of cells in the middles of other cells.
VectorXd sampled(const VectorXd& of, const CellGrid& cells, const CellGrid& at) {
  const ImageGrid middles{at.columns, at.rows, at.first_x_m, at.row_m / 2, at.spacing_m, at.row_m};
  VectorXd out(static_cast<Index>(at.size()));
  for (std::size_t c = 0; c < at.size(); ++c) out[static_cast<Index>(c)] = at_node(of, cells, middles, 0, c);
  return out;
}

}  // namespace

// What all models are held against: coarse cells, linear about a face.
struct ProbeFitter::Window {
  std::optional<double> beside_m;  // stated
  double beside_std_m;
  Known elevation, depth;
  double lateral_ratio = NAN;
  CellStrains measured = {};
  VectorXd of_depth = {};  // in images, from the middle of one
  CellGrid cells = {};
  double places = 0;    // of a cell, by what is independent in it
  VectorXd finer = {};  // ln(strain): what fine cells make of it beyond coarse ones
  ProbeFace face = {};  // of the reference, tissue that goes on: the changes of its ln(strain), ln(force)
  VectorXd by_tilt = {}, by_elevation = {}, by_depth = {};
  double force_by_elevation = 0, force_by_depth = 0;
};

struct ProbeFitter::Model {
  ProbeFace face;
  bool block = false;
  double log_prior = 0;
  double place_m = 0, step_m = 0;  // beside the probe, and from there to the next
  VectorXd by_beside = {};
  double force_by_beside = 0;
  const Answer* answer = nullptr;  // of `face`
  RobustFit fit = {};
  double weight = 0;
  double odds() const { return log_prior - fit.misfit; }  // ln, but for what all share
};

struct ProbeFitter::Weighed {
  Window window;
  std::vector<Model> models;
  double best() const {
    return std::ranges::max_element(models, {}, [](const Model& m) { return m.odds(); })->odds();
  }
  const Model& least() const {
    return *std::ranges::min_element(models, {}, [](const Model& m) { return m.fit.rest; });
  }
};

ProbeFitter::ProbeFitter(const Queue& queue, const StrainOptions& strain, std::shared_ptr<StripCache> strips)
    : queue_(queue), strain_(strain), strips_(std::move(strips)) {}

const ProbeFitter::Answer& ProbeFitter::answer(ProbeFace face, bool tilted, double cell_m) {
  face.depth_m = std::max(face.depth_m, face.image_depth_m);  // so that the cells are those of the image
  for (const auto& known : answers_)
    if (known->face == face && !known->block && known->cell_m == cell_m && (!tilted || known->by_tilt.size()))
      return *known;
  check_cancelled();
  // One that fails counts as well.
  coarse_solves_ += (tilted ? 2 : 1) * (cell_m == kCoarseCellM ? 1 : kCoarsePerSolve);
  if (cell_m == kFineCellM) kept_.reset();
  const auto tissue = make_probed_solid(queue_, face, cell_m);
  Answer out = answer_of(*tissue, face);
  out.cell_m = cell_m;
  if (tilted) {
    const VectorXd more =
        -as_measured(tissue->push_homogeneous(kTiltStep).axial_strain, tissue->cells(), strain_);
    out.by_tilt = (more.array() / out.log_strain.array().exp() - 1) / kTiltStep;
  }
  return keep(std::move(out));
}

const ProbeFitter::Answer& ProbeFitter::block_answer(const ProbeFace& face, const CellGrid& cells) {
  for (const auto& known : answers_)
    if (known->face == face && known->block) return *known;
  check_cancelled();
  coarse_solves_ += kCoarsePerSolve;
  Answer out = answer_of(*make_probed_block(face, *strips_, kCoarseCellM), face);
  out.block = true;
  out.log_strain = sampled(out.log_strain, out.cells, cells);
  return keep(std::move(out));
}

ProbeFitter::Answer ProbeFitter::answer_of(ProbedTissue& tissue, const ProbeFace& face) const {
  const ProbedTissue::Response level = tissue.push_homogeneous();
  const VectorXd strain = -as_measured(level.axial_strain, tissue.cells(), strain_);
  std::vector<double> sizes, ratios;
  for (Index c = 0; c < strain.size(); ++c)
    if (strain[c] > 0)
      sizes.push_back(strain[c]), ratios.push_back(-level.lateral_strain[c] / level.axial_strain[c]);
  if (sizes.empty()) throw std::invalid_argument("tissue_depth_m: no strain reaches the image; check it");
  return {face,
          false,
          kCoarseCellM,
          tissue.cells(),
          strain.cwiseMax(kLeastStrain * median(sizes)).array().log(),
          std::log(level.force_n),
          median(ratios),
          {}};
}

const ProbeFitter::Answer& ProbeFitter::keep(Answer answer) {
  answers_.push_back(std::make_unique<Answer>(std::move(answer)));
  return *answers_.back();
}

// At one scale, or that of what it leaves itself.
void ProbeFitter::fit(const Window& w, Model& m, double scale) {
  VectorXd residual = m.answer->log_strain - w.measured.log_strain;
  if (!m.block) residual += w.finer;
  std::vector<FitColumn> columns{{-w.by_tilt, 0, kUsualTilt, false}, {w.of_depth, 0, kUsualGrading, true}};
  if (!m.block) {
    const auto known = [&](const Known& of, const VectorXd& by, double at_m) {
      columns.push_back({-by, of.log - std::log(at_m), of.deviation, of.stated, kLinear});
    };
    known(w.elevation, w.by_elevation, m.face.elevation_m);
    known(w.depth, w.by_depth, m.face.depth_m);
    if (m.by_beside.size()) columns.push_back({-m.by_beside, 0, kOfGridStep, false});
  }
  m.fit = fit_robustly(residual, w.measured.observed, columns, w.places, scale);
  if (std::isfinite(w.lateral_ratio))
    m.fit.misfit += std::log1p(squared((w.lateral_ratio - m.answer->lateral_ratio) / kLateralRatio) / 2);
}

// To where its elevation, depth and end are linear.
void ProbeFitter::settle(const Window& w, Model& m, int rounds) {
  for (; rounds > 0 && !m.block; --rounds) {
    ProbeFace face = m.face;
    const auto moved = [](const Known& of, double at_m, double by) {
      return std::exp(std::clamp(std::log(at_m) + by, of.low, of.high));
    };
    face.elevation_m = moved(w.elevation, face.elevation_m, m.fit.at[kElevation]);
    face.depth_m = moved(w.depth, face.depth_m, m.fit.at[kDepth]);
    if (m.by_beside.size())
      face.beside_m = std::clamp(face.beside_m + m.step_m * m.fit.at[kBeside],
                                 std::max(0.0, m.place_m - m.step_m / 2), m.place_m + m.step_m / 2);
    const double way =
        std::max({std::abs(std::log(face.elevation_m / m.face.elevation_m)),
                  std::abs(std::log(face.depth_m / m.face.depth_m)),
                  m.step_m > 0 ? 0.5 * std::abs(face.beside_m - m.face.beside_m) / m.step_m : 0.0});
    if (way < kSettled) return;
    try {
      Model other = m;
      other.face = face, other.answer = &answer(face);
      fit(w, other, 0);
      m = std::move(other);
    } catch (const std::invalid_argument&) {  // beyond what is modelled
      return;
    }
  }
}

// Tissue that goes on, to where it is linear.
ProbeFitter::Model ProbeFitter::reference(Window& w, const ProbeFace& start, int rounds) {
  const Answer& fine = answer(start, false, kFineCellM);
  Model out{start};
  const auto linear = [&] {
    w.face = out.face;
    out.answer = &answer(w.face, true);
    w.by_tilt = out.answer->by_tilt;
    const auto by = [&](double ProbeFace::*length, VectorXd& of_strain, double& of_force) {
      // The one way or the other: it may stand at the edge of what is modelled.
      const auto varied = [&](double way) {
        ProbeFace face = w.face;
        face.*length *= std::exp(way);
        const Answer& other = answer(face);
        of_strain = (other.log_strain - out.answer->log_strain) / way;
        of_force = (other.log_force - out.answer->log_force) / way;
      };
      try {
        varied(kVary);
      } catch (const std::invalid_argument&) {
        varied(-kVary);
      }
    };
    by(&ProbeFace::elevation_m, w.by_elevation, w.force_by_elevation);
    by(&ProbeFace::depth_m, w.by_depth, w.force_by_depth);
  };
  linear();
  w.finer = sampled(fine.log_strain, fine.cells, w.cells) - out.answer->log_strain;
  for (int round = 1;; ++round) {
    fit(w, out, 0);
    if (round == rounds) return out;
    const Window last = w;
    const Model settled = out;
    settle(w, out, 1);
    if (out.face == settled.face) return out;
    try {
      linear();
    } catch (const std::invalid_argument&) {  // its neighbours are beyond what is modelled
      w = last;
      return settled;
    }
  }
}

// What else the tissue may be.
void ProbeFitter::consider_others(const Window& w, std::vector<Model>& models) {
  // What ends that far away is as if it went on; what ends that near, as if it were as wide as the probe.
  const bool stated = w.beside_m.has_value(),
             wide = stated && *w.beside_m >= kBesideDepths.back() * w.face.depth_m;
  const double stated_m = w.beside_m.value_or(0) < kAsWideM ? 0 : *w.beside_m;
  const double others = stated ? 1 - kBesideAsStated : 1, places = kBesideDepths.size(),
               end = (1 - kGoesOn - kIsBlock) / places;
  models[0].log_prior = std::log((kGoesOn * others + (wide ? kBesideAsStated : 0)) * (1 - kSlides));
  // A face that touches in part looks tilted, and sides would explain some of it.
  const bool tilted = std::abs(models[0].fit.at[kTilt]) > kMaxTiltOfSides;
  const auto consider = [&](Model model, double prior) {
    try {
      model.answer = model.block ? &block_answer(model.face, w.cells) : &answer(model.face);
      model.log_prior = std::log(prior);
      models.push_back(std::move(model));
    } catch (const std::invalid_argument&) {  // beyond what is modelled
    }
  };
  const auto with = [&](double beside_m, bool slides, double step_m = 0) {
    Model model{w.face};
    model.face.beside_m = model.place_m = beside_m, model.face.slides = slides, model.step_m = step_m;
    return model;
  };
  if (w.face.image_depth_m < kDeepestBlockM) {
    Model block = with(0, false);
    block.block = true, block.face.elevation_m = std::exp(w.elevation.log);
    consider(std::move(block), kIsBlock * others);
  }
  for (const bool slides : {false, true}) {
    const double of_support = slides ? kSlides : 1 - kSlides;
    if (tilted) {
      if (stated && !wide) consider(with(stated_m, slides), kBesideAsStated * of_support);
      continue;
    }
    const std::size_t first = models.size(), last = first + kBesideDepths.size() - 1;
    for (std::size_t k = 0; k < kBesideDepths.size(); ++k) {
      const bool inner = k + 1 < kBesideDepths.size();
      const double way =
          k > 0 ? (kBesideDepths[inner ? k + 1 : k] - kBesideDepths[k - 1]) / (inner ? 2 : 1) : 0;
      consider(with(w.face.depth_m * kBesideDepths[k], slides, w.face.depth_m * way),
               end * of_support * others);
    }
    // As wide as the probe is cut so: the first place stays.
    for (std::size_t k = first + 1; models.size() == last + 1 && k <= last; ++k) {
      const Model &before = models[k - 1], &after = models[std::min(k + 1, last)];
      const double steps = (after.face.beside_m - before.face.beside_m) / models[k].step_m;
      models[k].by_beside = (after.answer->log_strain - before.answer->log_strain) / steps;
      models[k].force_by_beside = (after.answer->log_force - before.answer->log_force) / steps;
    }
    if (!stated || wide || models.size() != last + 1) continue;
    // Its deviation moves it as the nearest place's step would.
    const Model& near =
        *std::ranges::min_element(models.begin() + static_cast<std::ptrdiff_t>(first) + 1, models.end(), {},
                                  [&](const Model& m) { return std::abs(m.place_m - stated_m); });
    const double std_m = w.beside_std_m > 0 ? w.beside_std_m : kLogStated * stated_m;
    Model as_stated = with(stated_m, slides, std_m / kOfGridStep);
    as_stated.by_beside = near.by_beside * as_stated.step_m / near.step_m;
    as_stated.force_by_beside = near.force_by_beside * as_stated.step_m / near.step_m;
    consider(std::move(as_stated), kBesideAsStated * of_support);
  }
}

ProbeFitter::Weighed ProbeFitter::weigh(Window window, const ProbeFace& start, bool all) {
  Weighed out{std::move(window), {}};
  out.models.push_back(reference(out.window, start, all ? kRounds : 1));
  if (!all) return out;
  consider_others(out.window, out.models);
  for (Model& m : out.models) fit(out.window, m, 0);
  const double scale = std::hypot(out.least().fit.rest, kModelLog);
  for (Model& m : out.models) fit(out.window, m, scale);
  const double best = out.best();
  for (Model& m : out.models)
    if (m.odds() > best - kWorthless) settle(out.window, m, kRoundsOfOthers);
  return out;
}

int ProbeFitter::max_solves(FitEffort effort) {
  // Of a reference: fine; level, tilted and two neighbours, or four; and where it moves to.
  constexpr int kReference = kCoarsePerSolve + 6 + 7 * (kRounds - 1), kFirst = kCoarsePerSolve + 6,
                kOthers = 2 * (static_cast<int>(kBesideDepths.size()) + 1),
                kWeigh = kReference + kCoarsePerSolve + kOthers + (1 + kOthers) * kRoundsOfOthers;
  const int coarse = effort == FitEffort::kUsual ? kFirst : kReference + 2 * kWeigh;
  return (coarse + kCoarsePerSolve - 1) / kCoarsePerSolve;
}

ProbeFit ProbeFitter::fit(const ModulusInput& in, double elevation_m, double sign, FitEffort effort) {
  constexpr std::ptrdiff_t kAnswers = 300;
  if (std::ssize(answers_) > kAnswers) answers_.clear();
  coarse_solves_ = 0;
  const Measured& measured = in.measured;
  const double top_m = top_of(measured), depth_m = in.tissue.depth_m - top_m;
  if (!(depth_m > 0))
    throw std::invalid_argument(
        fmt::format("tissue_depth_m: the tissue ends {:.1f} mm deep, but nothing was tracked above {:.1f} mm",
                    1e3 * in.tissue.depth_m, 1e3 * top_m));
  const double shown_m = measured.grid.y_m(measured.grid.size() - 1) + measured.grid.dy_m / 2 - top_m,
               image_m = in.tissue.depth_stated ? std::min(shown_m, depth_m) : shown_m;
  Window w{in.tissue.beside_m, in.tissue.beside_std_m, elevation_known(in.tissue, elevation_m),
           depth_known(in.tissue, depth_m, image_m)};
  if (const std::optional<double> ratio = lateral_ratio(measured)) w.lateral_ratio = *ratio;
  const auto usual = [&](const Window& of) {
    return ProbeFace{in.window_width_m, std::exp(of.elevation.log), std::exp(of.depth.log), image_m,
                     in.tissue.poisson_ratio};
  };
  const Answer& first = answer(usual(w), true);
  w.cells = first.cells;
  w.measured = cell_strains(measured, w.cells, top_m, sign);
  w.places = w.cells.spacing_m * w.cells.row_m / kAlikeM2;
  leave_out(first.log_strain, w.cells, w.measured.observed);
  w.of_depth.resize(first.log_strain.size());
  for (std::size_t c = 0; c < w.cells.size(); ++c)
    w.of_depth[static_cast<Index>(c)] = w.cells.y_m(c) / image_m - 0.5;

  const bool all = effort == FitEffort::kWeighed;
  Weighed found = weigh(w, usual(w), all);
  if (all) {
    std::vector<Weighed> starts;
    // What is stated may be wrong by more than is linear: from where it would be if nothing were stated.
    if (w.elevation.stated || w.depth.stated) {
      TissueExtent nothing = in.tissue;
      nothing.depth_stated = false;
      Window open = w;
      open.elevation = elevation_known(nothing, 0), open.depth = depth_known(nothing, depth_m, image_m);
      const auto far = [](const Known& stated, double at_m) {
        return stated.stated && std::abs(std::log(at_m) - stated.log) > kFarFromStated * stated.deviation;
      };
      try {
        const ProbeFace free = reference(open, usual(open), kRounds).face;
        if (far(w.elevation, free.elevation_m) || far(w.depth, free.depth_m))
          starts.push_back(weigh(w, free, true));
      } catch (const std::invalid_argument&) {  // that face is beyond what is modelled
      }
    }
    starts.push_back(std::move(found));
    const Model& least =
        std::ranges::min_element(starts, {}, [](const Weighed& s) { return s.least().fit.rest; })->least();
    const double scale = std::hypot(least.fit.rest, kModelLog),
                 places = w.cells.spacing_m * w.cells.row_m / alike_m2(least.fit.left, w.cells, scale);
    for (Weighed& start : starts) {
      start.window.places = places;
      for (Model& m : start.models) fit(start.window, m, scale);
    }
    found = std::move(*std::ranges::max_element(starts, {}, [](const Weighed& s) { return s.best(); }));
  }
  const double best = found.best();
  double sum = 0;
  for (Model& m : found.models) sum += m.weight = std::exp(m.odds() - best);
  for (Model& m : found.models) m.weight /= sum;
  ProbeFit out = publish(found, in, sign, all);
  out.top_m = top_m;
  if (top_m > 0) out.words += fmt::format("; the tissue is taken to begin {:.1f} mm deep", 1e3 * top_m);
  out.solves = (coarse_solves_ + kCoarsePerSolve - 1) / kCoarsePerSolve;
  return out;
}

ProbeFit ProbeFitter::publish(const Weighed& weighed, const ModulusInput& in, double sign, bool all) {
  const Window& w = weighed.window;
  // By kind: what ends here or there ends.
  struct Kind {
    const Model* of;
    double weight;
  };
  std::map<std::array<int, 2>, Kind> kinds;
  for (const Model& m : weighed.models) {
    const int ends = m.block ? 3 : m.face.goes_on() ? 0 : m.face.beside_m > 0 ? 1 : 2;
    Kind& kind = kinds.try_emplace({ends, m.face.slides}, Kind{&m, 0}).first->second;
    kind.weight += m.weight;
    if (m.weight > kind.of->weight) kind.of = &m;
  }
  std::vector<Kind> order;
  for (const auto& [_, kind] : kinds) order.push_back(kind);
  std::ranges::sort(order, std::ranges::greater{}, [](const Kind& k) { return k.weight; });
  const Model& likeliest = *order[0].of;

  // In the cells of the likeliest.
  ProbeFit out;
  out.face = likeliest.face;
  if (!kept_ || kept_->face != out.face || kept_->block != likeliest.block) {
    kept_.reset();
    kept_ = {out.face, likeliest.block,
             likeliest.block ? make_probed_block(out.face, *strips_) : make_probed_solid(queue_, out.face)};
  }
  out.tissue = kept_->tissue;
  const CellGrid& cells = out.tissue->cells();
  const auto in_cells = [&](const VectorXd& coarse) { return sampled(coarse, w.cells, cells); };
  out.measured = cell_strains(in.measured, cells, top_of(in.measured), sign);
  leave_out(in_cells(likeliest.answer->log_strain), cells, out.measured.observed);
  out.by_tilt = in_cells(w.by_tilt);
  out.lateral_ratio = likeliest.answer->lateral_ratio;

  // Of a face on tissue that goes on, about the same for all.
  double log_share = 0;
  if (in.force && std::ranges::any_of(weighed.models, [](const Model& m) {
        return m.face.goes_on() && m.weight > kLeastWeight;
      }))
    log_share = std::log(out.face.goes_on() ? out.tissue->force_share()
                                            : make_probed_solid(queue_, w.face, kCoarseCellM)->force_share());
  // An absolute modulus goes as the strain that a force brings, a relative one as the strain beside its mean.
  const double observed = w.measured.observed.sum();
  const auto of_modulus = [&](VectorXd log_strain, double log_force) {
    log_strain.array() -= in.force ? log_force : w.measured.observed.dot(log_strain) / observed;
    return log_strain;
  };
  const auto found = [&](const Model& m, double share = 1) {
    VectorXd log_strain = m.answer->log_strain;
    if (!m.block) log_strain += w.finer;
    double log_force = m.answer->log_force - (m.face.goes_on() ? log_share : 0);
    const auto add = [&](Index column, const VectorXd& of_strain, double of_force) {
      log_strain += share * m.fit.at[column] * of_strain, log_force += share * m.fit.at[column] * of_force;
    };
    if (!m.block && all) {
      add(kElevation, w.by_elevation, w.force_by_elevation), add(kDepth, w.by_depth, w.force_by_depth);
      if (m.by_beside.size()) add(kBeside, m.by_beside, m.force_by_beside);
    }
    return of_modulus(std::move(log_strain), log_force);
  };
  const VectorXd used = found(likeliest, 0);
  VectorXd mean = VectorXd::Zero(used.size());
  for (const Model& m : weighed.models)
    if (m.weight > kLeastWeight) mean += m.weight * (found(m) - used);
  out.shift = in_cells(mean);
  VectorXd variance = VectorXd::Zero(used.size());
  for (const Model& m : weighed.models)
    if (m.weight > kLeastWeight) variance += m.weight * (found(m) - used - mean).cwiseAbs2();
  out.between = in_cells(variance.cwiseSqrt());
  // And what the likeliest leaves open of itself; of a block, whose length alone bears the force, that.
  if (likeliest.block && in.force)
    out.changes.push_back(VectorXd::Constant(static_cast<Index>(cells.size()), w.elevation.deviation));
  if (!likeliest.block) {
    std::vector<VectorXd> by{of_modulus(w.by_elevation, w.force_by_elevation),
                             of_modulus(w.by_depth, w.force_by_depth)};
    if (likeliest.by_beside.size()) by.push_back(of_modulus(likeliest.by_beside, likeliest.force_by_beside));
    const auto count = static_cast<Index>(by.size());
    MatrixXd covariance = likeliest.fit.covariance.block(kElevation, kElevation, count, count);
    if (!all)
      covariance = Eigen::Vector2d(squared(w.elevation.deviation), squared(w.depth.deviation)).asDiagonal();
    const MatrixXd root = covariance.llt().matrixL();
    for (Index k = 0; k < count; ++k) {
      VectorXd change = VectorXd::Zero(used.size());
      for (Index l = k; l < count; ++l) change += root(l, k) * by[static_cast<std::size_t>(l)];
      out.changes.push_back(in_cells(change));
    }
  }
  out.common_log = likeliest.block || out.face.goes_on() ? kCommonLog : kCommonLogOfSides;
  const double grading = likeliest.fit.at[kGrading];
  out.rest = std::abs(grading) < kMaxGrading ? likeliest.fit.rest
                                             : std::hypot(likeliest.fit.rest, kSpreadOfDepth * grading);
  out.as_usual = !all && !(w.elevation.stated && w.depth.stated);
  out.unweighed = !all && (out.rest > kWellExplained || std::abs(grading) > kNotedGrading);
  // Nor was it where the face is tilted so much.
  const bool tilted = std::abs(likeliest.fit.at[kTilt]) > kMaxTiltOfSides && out.rest > kWellExplained;
  if (out.unweighed || tilted) out.common_log = std::hypot(out.common_log, kUnweighedLog);
  const auto fitted = [&](double at_m, Index column) {
    return all && !likeliest.block ? at_m * std::exp(likeliest.fit.at[column]) : at_m;
  };
  const double elevation_m = fitted(out.face.elevation_m, kElevation),
               depth_m = fitted(out.face.depth_m, kDepth);
  const auto contradicts = [&](const Known& known, double at_m, const char* what) {
    if (!known.contradicted(at_m)) return;
    out.contradicted +=
        fmt::format("{}{} is stated as {:.1f} mm, but the strain shows {:.1f} mm",
                    out.contradicted.empty() ? "" : "; ", what, 1e3 * std::exp(known.log), 1e3 * at_m);
  };
  contradicts(w.elevation, elevation_m, "the face's length across the image");
  if (!likeliest.block) contradicts(w.depth, depth_m, "the tissue's depth");
  if (!out.contradicted.empty()) out.common_log = std::hypot(out.common_log, kContradictedLog);

  const auto origin = [&](const Known& of, double at_m) {
    return of.contradicted(at_m) ? fmt::format("stated as {:.1f}", 1e3 * std::exp(of.log))
                                 : std::string(of.stated      ? "stated"
                                               : out.as_usual ? "usual"
                                                              : "fitted");
  };
  const auto words_of = [](const Model& m) -> std::string {
    if (m.block) return "is a block as wide as the probe, its bottom unseen";
    const std::string end = m.face.goes_on() ? "continues beside the probe"
                            : m.face.beside_m > 0
                                ? fmt::format("ends some {:.0f} mm beside the probe", 1e3 * m.face.beside_m)
                                : "is as wide as the probe";
    return end + (m.face.slides ? " and slides on its support" : "");
  };
  std::string tissue = words_of(likeliest);
  if (order[0].weight < kSure)
    tissue += fmt::format(" (weight {:.2f}; or {}: {:.2f})", order[0].weight, words_of(*order[1].of),
                          order[1].weight);
  const std::string deep =
      likeliest.block ? "" : fmt::format(" {:.0f} mm deep ({})", 1e3 * depth_m, origin(w.depth, depth_m));
  out.words = fmt::format(
      "solid tissue{} that {}, under a face of {:.1f} x {:.1f} mm ({}): {:.0f} % of the strain unexplained "
      "where it is homogeneous",
      deep, tissue, 1e3 * out.face.width_m, 1e3 * elevation_m, origin(w.elevation, elevation_m),
      100 * out.rest);
  if (std::abs(grading) > kNotedGrading)
    out.words +=
        fmt::format("; its modulus {} by a factor of {:.1f} from the face to the bottom of the image",
                    grading < 0 ? "falls" : "rises", std::exp(std::abs(grading)));
  return out;
}

}  // namespace teletact::service
