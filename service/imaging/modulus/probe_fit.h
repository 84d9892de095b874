// How the probe stands on the tissue, fitted to the axial strain of what looks homogeneous (T3.6): which kind
// of tissue it is, tilt, and what is not stated of the face.
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

// What is tried, decided before the first solve: nothing, what is not stated of the face, and what else may
// explain the strain.
enum class FitEffort { kUsual, kFitted, kDoubted };

struct ProbeFit {
  std::shared_ptr<ProbedTissue> tissue;
  ProbeFace face;
  double top_m = 0;  // depth of the face in the image
  CellStrains measured;
  Eigen::VectorXd homogeneous;  // strain of the cells as measured, > 0 where it is compression, per metre
  Eigen::VectorXd by_tilt;      // d ln(strain) of the cells per unit of tilt
  double lateral_ratio = 0;     // - lateral over axial strain, median of the cells that are observed
  // Change of ln E of the cells by one standard deviation of each thing that was fitted.
  std::vector<Eigen::VectorXd> changes;
  double common_log = 0;  // of ln E: the mesh, and what the tissue does at its sides
  double rest = 0;        // of ln(strain): what is unexplained where tissue looks homogeneous
  double tilt = 0;        // that leaves that
  // ln of the modulus at the bottom of the image over that at the face, and what is unexplained with it.
  double grading = 0, graded_rest = 0;
  double level = 0;        // ln of a metre over the push that was measured
  double force_n = 0;      // on the face, of homogeneous tissue of 1 Pa, per metre of push
  bool as_usual = false;   // something that is not stated was not fitted
  bool undoubted = false;  // it leaves much unexplained, and what may explain it was not tried
  int solves = 0;          // of the forward model
  std::string words;       // what was assumed and what was found
};

class ProbeFitter {
 public:
  ProbeFitter(const Queue&, const StrainOptions&, std::shared_ptr<StripCache>);
  // `elevation_m`: 0 where it is not known; `sign` of the strain that counts. Throws NoCompression, and
  // std::invalid_argument naming the field.
  ProbeFit fit(const ModulusInput&, double elevation_m, double sign, FitEffort);
  // The most that fit() solves.
  static int max_solves(const ModulusInput&, double elevation_m, FitEffort);

  void forget() { kept_.reset(); }

 private:
  struct Pair {
    const Measured& measured;
    double top_m, sign;
  };
  struct Unknown;
  void search(const Pair&, Unknown&, int rounds);
  // Tissue, and how it answers where it is homogeneous.
  struct Kept {
    ProbeFace face;
    bool block;
    std::shared_ptr<ProbedTissue> tissue;
    ProbedTissue::Response level;
    std::optional<ProbedTissue::Response> tilted;
  };
  Kept& kept(const ProbeFace&, bool block);
  void doubt(const Pair&, Unknown&, ProbeFit&, const ModulusInput&);
  // Another explanation that was tried, and how much of the strain it leaves.
  struct Rival {
    double left, log_scale;
  };
  void try_others(const Pair&, Unknown&, ProbeFit&, std::vector<Rival>&);
  // The tissue under such a face, and how well it explains what was measured; `by_tilt` of a face much like
  // it, which is used where it has the same cells.
  ProbeFit tried(const Pair&, const ProbeFace&, const Eigen::VectorXd* by_tilt = nullptr, bool block = false);
  Queue queue_;
  StrainOptions strain_;
  std::shared_ptr<StripCache> strips_;
  std::optional<Kept> kept_;  // of the pair before
  int solves_ = 0;
};

}  // namespace teletact::service
