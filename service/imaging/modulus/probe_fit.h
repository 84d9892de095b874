// What the tissue under a probe may be, weighed by the axial strain of what looks homogeneous (T3.6): where
// it ends beside the probe, what it lies on, how deep it is, how long the face, how it is tilted.
#pragma once

#include <Eigen/Core>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "service/imaging/modulus/cell_strains.h"
#include "service/imaging/modulus/modulus.h"
#include "service/imaging/modulus/probed_tissue.h"
#include "service/imaging/modulus/tissue_extent.h"

namespace teletact::service {

// Over so much of the image tissue and model differ alike.
inline constexpr double kAlikeM2 = 25e-6;
inline constexpr double kModelLog = 0.05;  // of ln(strain): what no such model explains
inline constexpr double kUsualTilt = 0.3;  // of the push, to an end of the face

// What is tried, decided before the first solve: tissue that goes on beside the probe under a face as stated
// or usual; or all.
enum class FitEffort { kUsual, kWeighed };

// Cells are those of `tissue`.
struct ProbeFit {
  std::shared_ptr<ProbedTissue> tissue;  // the likeliest
  ProbeFace face;
  double top_m = 0;  // depth of the face in the image
  CellStrains measured;
  Eigen::VectorXd by_tilt;   // d ln(strain) per unit of tilt
  double lateral_ratio = 0;  // - lateral over axial strain, median
  // What ln E is beyond that of the likeliest tissue, in the mean over all by their weights; the root of its
  // variance between them; and its change by one standard deviation of each thing that the likeliest leaves
  // open of itself.
  Eigen::VectorXd shift, between;
  std::vector<Eigen::VectorXd> changes;
  double common_log = 0;     // of ln E: the mesh, what the tissue does at its sides, what was not tried
  double rest = 0;           // of ln(strain): what is unexplained where tissue looks homogeneous
  bool as_usual = false;     // something that is not stated was not fitted
  bool unweighed = false;    // it leaves much unexplained, and what may explain it was not tried
  int solves = 0;            // of the forward model
  std::string words;         // what was assumed and what was found
  std::string contradicted;  // which of what is stated the strain contradicts
};

class ProbeFitter {
 public:
  ProbeFitter(const Queue&, const StrainOptions&, std::shared_ptr<StripCache>);
  // `elevation_m`: 0 where it is not known; `sign` of the strain that counts. Throws NoCompression, and
  // std::invalid_argument naming the field.
  ProbeFit fit(const ModulusInput&, double elevation_m, double sign, FitEffort);
  // The most that fit() solves.
  static int max_solves(FitEffort);

  void forget() { kept_.reset(), answers_.clear(); }

 private:
  struct Window;
  struct Model;
  // How homogeneous tissue answers a push.
  struct Answer {
    ProbeFace face;
    bool block;
    double cell_m;
    CellGrid cells;
    Eigen::VectorXd log_strain;  // as measured
    double log_force, lateral_ratio;
    Eigen::VectorXd by_tilt;  // d ln(strain), where it was asked for
  };
  const Answer& answer(ProbeFace, bool tilted = false, double cell_m = kCoarseCellM);
  const Answer& block_answer(const ProbeFace&, const CellGrid&);
  Answer answer_of(ProbedTissue&, const ProbeFace&) const;
  const Answer& keep(Answer);
  struct Weighed;  // all models about one face
  void fit(const Window&, Model&, double scale);
  void settle(const Window&, Model&, int rounds);
  Model reference(Window&, const ProbeFace& start, int rounds);
  void consider_others(const Window&, std::vector<Model>&);
  Weighed weigh(Window, const ProbeFace& start, bool all);
  ProbeFit publish(const Weighed&, const ModulusInput&, double sign, bool all);
  Queue queue_;
  StrainOptions strain_;
  std::shared_ptr<StripCache> strips_;
  std::vector<std::unique_ptr<Answer>> answers_;  // of this window and those before
  struct Kept {
    ProbeFace face;
    bool block;
    std::shared_ptr<ProbedTissue> tissue;
  };
  std::optional<Kept> kept_;  // of the pair before
  int coarse_solves_ = 0;
};

}  // namespace teletact::service
