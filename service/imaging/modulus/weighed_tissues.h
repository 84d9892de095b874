// Tissues that may lie under a probe, weighed by the axial strain of what looks homogeneous (T3.6): each is
// solved homogeneous on coarse cells, and fitted to the strain with what is not known of it.
#pragma once

#include <Eigen/Core>
#include <algorithm>
#include <array>
#include <cmath>
#include <memory>
#include <optional>
#include <vector>

#include "service/base/memory.h"
#include "service/imaging/modulus/cell_strains.h"
#include "service/imaging/modulus/probed_tissue.h"
#include "service/imaging/modulus/robust_fit.h"
#include "service/imaging/modulus/skin.h"

namespace teletact::service {

// Over so much of the image tissue and model differ alike.
inline constexpr double kAlikeM2 = 25e-6;
inline constexpr double kModelLog = 0.02;       // of ln(strain): what no homogeneous model explains
inline constexpr double kLinear = 0.15;         // of ln of elevation and depth: as far as a step is true
inline constexpr double kUsualTilt = 0.3;       // of the push, to an end of the face
inline constexpr double kMaxTiltOfSides = 0.2;  // of the same: with more no sides are tried
inline constexpr double kLogStated = 0.1;       // of what is stated without a deviation of its own
inline constexpr double kOtherLength = 0.25;    // of ln of depth or elevation: other tissue of the same kind
inline constexpr double kLeastWeight = 0.01;    // of a tissue that counts
inline constexpr double kWorthless = 5;         // ln of the odds against a model that is not looked at closer
inline constexpr double kOfGridStep = 0.3;      // deviation of where it ends, in steps between the places
inline constexpr double kSkinBeside = 0.3;      // depths beside the face: nearer sides change what skin does
inline constexpr int kCoarsePerSolve = 4;       // solves of coarse tissue that take as long as a fine one
inline constexpr int kRoundsOfReference = 3;
inline constexpr double kMostPadLog = 3;  // of ln of a pad's modulus over the tissue's

// Of CandidateTissue::fit; a block has the first two, what goes on the first four. Those of a pad come last.
enum FitColumns { kTilt, kGrading, kElevation, kDepth, kBeside };
// Of a pad's thickness, which neither a block nor a fit as stated has; then that of its modulus.
inline Eigen::Index pad_column(const RobustFit& fit) {
  return fit.at.size() - 2;
}

// What is known of ln of a length beforehand.
struct KnownLength {
  bool stated;
  double log, deviation, low, high;
  static constexpr double kContradicted = 2;  // deviations
  bool contradicted(double at_m) const {
    return stated && std::abs(std::log(at_m) - log) > kContradicted * deviation;
  }
};

// How homogeneous tissue answers a push.
struct TissueAnswer {
  ProbeFace face;
  bool block;
  CellGrid cells;
  Eigen::VectorXd log_strain;  // as measured
  double log_force, lateral_ratio;
  Eigen::VectorXd by_tilt;  // d ln(strain), where it was asked for
  Charge held = {};
};

// What fine cells make of it beyond coarse ones, in those: of ln(strain), and what its skin changes.
struct FineAnswer {
  ProbeFace face;
  Eigen::VectorXd finer;
  std::optional<SkinAnswer> skin;
  Charge held = {};
};

// What a length of tissue changes: of ln(strain) in each cell, of ln(force), by ln of it.
struct ByLength {
  Eigen::VectorXd strain = {};
  double force = 0;
};

// What all models are held against: coarse cells, linear about a face.
struct TissueWindow {
  std::optional<double> beside_m;  // stated
  double beside_std_m;
  KnownLength elevation, depth;
  SkinPrior skin = {};
  bool as_stated = false;  // a level and a tilt alone are fitted
  double lateral_ratio = NAN;
  CellStrains measured = {};
  Eigen::VectorXd of_depth = {};  // in images, from the middle of one
  CellGrid cells = {};
  double places = 0;  // of a cell, by what is independent in it
  Eigen::VectorXd finer = {};
  ProbeFace face = {};  // of the reference, tissue that goes on
  Eigen::VectorXd by_tilt = {};
  // Where the face has a pad: its thickness, ln of its modulus over the tissue's, about, and what both
  // change.
  KnownLength pad = {};
  double pad_log = 0;
  ByLength by_pad_thickness = {};
  Eigen::VectorXd by_pad_modulus = {};
  SkinAnswer by_skin = {};  // where more than a level and a tilt is fitted
  // What other slices told: the reference is that of the nearest. Each other tissue begins where it was
  // there, and moves on where it counts by all of them.
  std::vector<ToldBeside> told = {};
};

struct CandidateTissue {
  ProbeFace face;
  bool block = false;
  double log_prior = 0;
  double place_m = 0, step_m = 0;  // beside the probe, and from there to the next
  Eigen::VectorXd by_beside = {};
  double force_by_beside = 0;
  const TissueAnswer* answer = nullptr;  // of `face`
  // The reference's until its own are known: beside tissue that ends, a face's elevation changes less.
  ByLength by_elevation = {}, by_depth = {};
  RobustFit fit = {};
  // The same with the skin's changes as the last columns, where the tissue goes on far enough beside the face
  // for them: not to tell tissues apart, whose sides look like skin.
  std::optional<RobustFit> with_skin = {};
  double weight = 0;
  double odds() const { return log_prior - fit.misfit; }  // ln, but for what all share
};

struct WeighedTissues {
  TissueWindow window;
  std::vector<CandidateTissue> models;
  double best() const {
    return std::ranges::max_element(models, {}, [](const CandidateTissue& m) { return m.odds(); })->odds();
  }
  const CandidateTissue& least() const {
    return *std::ranges::min_element(models, {}, [](const CandidateTissue& m) { return m.fit.rest; });
  }
};

// A field of cells in the middles of other cells.
Eigen::VectorXd sampled(const Eigen::VectorXd& of, const CellGrid& cells, const CellGrid& at);

// Used by one thread at a time. What it finds does not depend on what it keeps.
class TissueWeigher {
 public:
  TissueWeigher(const Queue&, const StrainOptions&, std::shared_ptr<StripCache>);
  // Of tissue that goes on, ends or slides, in coarse cells. Throws std::invalid_argument, DeviceError.
  const TissueAnswer& answer(ProbeFace, bool tilted = false);
  const FineAnswer& fine(const ProbeFace&, bool with_skin);
  // The last of its cells, or with its solver where the mesh is the same. Throws alike.
  std::shared_ptr<ProbedTissue> solid(const ProbeFace&, double cell_m);
  // The reference, which moves from its start in `rounds` less one unless slices told it; `all`: what else
  // the tissue may be, too.
  WeighedTissues weigh(TissueWindow, const ProbeFace& start, bool all, int rounds);
  // To the window's strain, at one scale, or (0) that of what it leaves itself.
  void fit(const TissueWindow&, CandidateTissue&, double scale) const;
  void fit_skin(const TissueWindow&, CandidateTissue&, double scale) const;

  void begin();  // a fit: counts its solves, and forgets what was kept where it is much
  int coarse_solves() const { return coarse_solves_; }
  static int max_coarse_solves(bool all, bool pad);  // of reference() and weigh() together
  void forget() { answers_.clear(), fine_.reset(), solids_ = {}; }

 private:
  // Tissue that goes on, from `start` to where it is linear; the window is then about its face.
  CandidateTissue reference(TissueWindow&, const ProbeFace& start, int rounds);
  static int max_coarse_solves_of_reference(bool pad);
  const TissueAnswer& block_answer(const ProbeFace&, const CellGrid&);
  TissueAnswer answer_of(ProbedTissue&, const ProbeFace&) const;
  const TissueAnswer& keep(TissueAnswer);
  ByLength by(double ProbeFace::*length, const CandidateTissue&);
  enum class Begun { kNot, kFailed, kYes };  // the last two take a solve
  Begun begin_as_told(const TissueWindow&, CandidateTissue&);
  void settle(const TissueWindow&, CandidateTissue&, int rounds);
  void consider_others(const TissueWindow&, std::vector<CandidateTissue>&);
  Queue queue_;
  StrainOptions strain_;
  std::shared_ptr<StripCache> strips_;
  std::vector<std::unique_ptr<TissueAnswer>> answers_;  // of this window and those before
  std::optional<FineAnswer> fine_;                      // the last one
  struct Solid {
    ProbeFace face;
    std::shared_ptr<ProbedTissue> tissue;
  };
  std::array<Solid, 2> solids_;  // the last of fine cells and of coarse
  int coarse_solves_ = 0;
};

// As far as it may lie from there where its place is.
double within_place(const CandidateTissue&, double beside_m);
// The face that a fit leads to, of a solid, and how far that is: of ln of its lengths, in half steps of its
// end.
ProbeFace led_to(const TissueWindow&, const CandidateTissue&, const RobustFit&);
double way_to(const ProbeFace&, const CandidateTissue&);
// What ends here or there ends: whether and how, and whether it slides.
std::array<int, 2> kind_of(const CandidateTissue&);

}  // namespace teletact::service
