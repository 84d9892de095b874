// What lies under a probe (T3.6): the likeliest tissue and, from the weights of the others, what it leaves
// open: where it ends beside the probe, what it lies on, how deep it is, how long the face.
#pragma once

#include <Eigen/Core>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "service/imaging/modulus/cell_strains.h"
#include "service/imaging/modulus/modulus.h"
#include "service/imaging/modulus/weighed_tissues.h"

namespace teletact::service {

// What is tried, decided before the first solve: tissue that goes on beside the probe under a face as stated
// or usual; or all that it may be, about that; or all from shallower tissue, too.
enum class FitEffort { kUsual, kWeighed, kAllStarts };

// Cells are those of `tissue`.
struct ProbeFit {
  std::shared_ptr<ProbedTissue> tissue;  // the likeliest
  ProbeFace face;
  double top_m = 0;  // depth of the face in the image
  CellStrains measured;
  Eigen::VectorXd by_tilt;   // d ln(strain) per unit of tilt
  double lateral_ratio = 0;  // - lateral over axial strain, median
  // What ln E is beyond that of the likeliest tissue, in the mean over all by their weights; the root of its
  // variance between them; and its changes by one standard deviation of what each leaves open of itself.
  Eigen::VectorXd shift, between;
  std::vector<Eigen::VectorXd>
      between_modes;      // of which, but for little, `between` is the root of the squares
  Eigen::VectorXd above;  // ln E of the skin's layers, or of a pad, over that below
  std::vector<Eigen::VectorXd> changes;
  double common_log = 0;         // of ln E: the mesh, what the tissue does at its sides, what was not tried
  double untried_log = 0;        // of that, what is alike of tissue that a tilted face leaves untried
  double rest = 0;               // of ln(strain): what is unexplained where tissue looks homogeneous
  bool as_usual = false;         // something that is not stated was not fitted
  std::string untried;           // what else there was no time for
  bool unweighed = false;        // and much is unexplained
  int solves = 0;                // of the forward model
  std::vector<ToldTissue> told;  // where tissues were weighed
  std::string words;             // what was assumed and what was found
  std::string contradicted;      // which of what is stated the strain contradicts
};

class ProbeFitter {
 public:
  ProbeFitter(const Queue&, const StrainOptions&, std::shared_ptr<StripCache>);
  // `elevation_m`: 0 where it is not known; `sign` of the strain that counts. Throws NoCompression, and
  // std::invalid_argument naming the field.
  ProbeFit fit(const ModulusInput&, double elevation_m, double sign, FitEffort);
  // The most that fit() solves.
  static int max_solves(FitEffort, bool pad);

  void forget() { weigher_.forget(); }

 private:
  bool astray(const WeighedTissues& start) const;
  std::optional<ProbeFace> far_from_stated(const WeighedTissues& start);
  ProbeFit publish(const std::vector<WeighedTissues>& starts, const ModulusInput&, double sign, bool all,
                   const char* untried);
  std::shared_ptr<StripCache> strips_;
  TissueWeigher weigher_;
};

}  // namespace teletact::service
