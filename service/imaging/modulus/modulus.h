// Young's modulus from displacement and strain (T3). One interface, four methods: reference stress (T3.1),
// direct (T3.2), iterative (T3.3), solid (T3.6).
#pragma once

#include <fmt/format.h>

#include <algorithm>
#include <limits>
#include <memory>
#include <optional>
#include <stdexcept>
#include <string>
#include <utility>
#include <vector>

#include "service/base/warning.h"
#include "service/device/device.h"
#include "service/imaging/modulus/strip_model.h"
#include "service/imaging/modulus/tissue_extent.h"
#include "service/imaging/modulus/window_nodes.h"
#include "service/imaging/tracking/frame.h"
#include "service/imaging/tracking/measured.h"

namespace teletact::service {

// Work that an estimate of the modulus may do, counted before it begins. What it finds does not depend on how
// long that takes.
struct ModulusBudget {
  static constexpr int kAll = std::numeric_limits<int>::max();
  bool start = true;  // the direct method, which the iterative one begins with
  int steps = kAll;   // of the iterative method after that
  int solves = kAll;  // of a solid: pushes of its forward model
  // For people, why not all of them; of a budget without a start: why there is none.
  std::string why_steps{}, why_solves{};

  // The less of both, and why that.
  void restrict_to(const ModulusBudget&);
};

struct ModulusInput {
  const Measured& measured;
  double window_width_m;  // lines * pitch: the probe's face
  TissueExtent tissue;
  std::optional<ProbeForce> force;  // absent: relative modulus
  KnownModulus known = {};          // by other windows; empty: unknown; not used for a relative modulus
  ModulusBudget budget = {};
  // Error of log E that is allowed: an iteration has settled once its steps change a third of it.
  double tolerance = 0.03;
  // The estimate of make_reference_stress() without corrections, where it is known: the direct method begins
  // with it.
  const struct ModulusEstimate* reference = nullptr;
  // Other slices of a solid, by offset_m, none at 0.
  std::vector<SliceBeside> beside = {};
  std::vector<ToldBeside> told = {};  // of any of them
  double sound_speed_deviation = 0;   // of its logarithm
};

enum class ModulusKind { kReferenceStress, kDirect, kIterative, kSolid };

using ModulusFlag = WarningFlag;  // those of the modulus come first

// Changes of ln E by one standard deviation of each cause that is wrong in many places at once (T9.4).
struct LogModes {
  ImageGrid grid = {};
  std::vector<float> values = {};  // [cause][y][x]
  std::size_t count() const { return values.empty() ? 0 : values.size() / grid.size(); }
  void add_everywhere(double deviation) {
    values.insert(values.end(), grid.size(), static_cast<float>(deviation));
  }
};

struct ModulusEstimate {
  Field youngs_modulus;     // Pa, or relative (median 1); NaN where nothing can be said
  Field log_deviation;      // standard deviation of log E; NaN where youngs_modulus is; empty: not computed
  LogModes log_modes = {};  // of a solid: parts of it; the rest is known place by place
  double median_deviation = 0;  // of log_deviation over the nodes that say something; 0: not computed
  double common_deviation = 0;  // part of log_deviation that all places share, by what is stated (T3.10)
  // Errors of log E at two places correlate by exp(-distance / it); assumed by methods that do not find it.
  double correlation_m = 0.0035;
  ModulusKind kind = ModulusKind::kReferenceStress;
  bool converged = true;
  int iterations = 0;
  int solves = 0;      // of a solid's forward model
  double start_s = 0;  // of work, that the direct method took where an iteration began with it
  std::vector<Warning> warnings;
  bool absolute = false;
  double model_deviation = 0;           // of ln E, common: between models that the strain does not tell apart
  double unstated_deviation = 0;        // of ln E: by what was not stated of face and tissue
  double background = 0;                // median over the nodes that say something, Pa or 1
  double mean_axial_strain = 0;         // median over the trusted nodes, negative in compression
  std::optional<double> lateral_ratio;  // - eps_xx / eps_yy of the model; else of its plane condition
  std::vector<ToldTissue> told = {};    // of a solid's slice; empty: its strain is not explained
  std::string model;                    // what was assumed and fitted of the tissue; empty: what was stated
  std::string why;                      // how the method was chosen, in words; empty: it was named
  // Of each flag there is one warning, which has all that is said of it.
  template <class... Args>
  void warn(ModulusFlag flag, fmt::format_string<Args...> words, Args&&... args) {
    std::string text = fmt::format(words, std::forward<Args>(args)...);
    if (const auto said = std::ranges::find(warnings, flag, &Warning::flag); said != warnings.end())
      said->text += "; " + text;
    else
      warnings.push_back({flag, std::move(text)});
  }
};

// The pair shows less strain than can be measured.
struct NoCompression : std::runtime_error {
  using std::runtime_error::runtime_error;
};

class ModulusMethod {
 public:
  virtual ~ModulusMethod() = default;
  // Throws NoCompression; std::invalid_argument for an unusable tissue extent or force (field named).
  virtual ModulusEstimate estimate(const ModulusInput&) = 0;
  // Gives back what is kept for the next pair.
  virtual void forget() {}
};

struct ReferenceStressOptions {
  int corrections = 3;  // times that the reference is solved again with the modulus found so far
  // Part of the median homogeneous strain below which nothing is said: near the bonded bottom and its corners
  // the probe hardly strains the tissue, and the corrections would amplify any error there.
  double min_reference = 0.5;
};

// T3.1; kernels/modulus.cl and StripModel. E = (P / P_ref) E_ref eps_ref / eps_yy, at first with homogeneous
// tissue as the reference, then (`corrections`) with the modulus found so far: the stress that stiff
// inclusions draw to themselves, and the plane-strain contrast (C + 1) / 2 of T3.1, are corrected.
std::unique_ptr<ModulusMethod> make_reference_stress(
    Queue, ReferenceStressOptions, std::shared_ptr<StripCache> = std::make_shared<StripCache>());

struct DirectOptions {
  // Times that border and lateral displacement are taken again from a forward solve, with the direct map; it
  // ends sooner when the modulus that such a solve would be given differs less from that of the one before
  // (log E, rms under the probe).
  int max_corrections = 4;
  double settled = 0.02;
};

// T3.2; DirectProblem. Its border, the lateral displacement (an order noisier than the axial one) and what
// was not measured come from a forward solve, at first with the modulus of the reference stress, whose
// inclusions are too soft, then with that of this method.
std::unique_ptr<ModulusMethod> make_direct(Queue, DirectOptions,
                                           std::shared_ptr<StripCache> = std::make_shared<StripCache>());

// T3.3: the modulus whose strip reproduces the measured axial displacement, with total variation on log E:
//   1/2 |(S u(E) a + b - d) / sigma|^2 + alpha TV(log E) + prior.
// Gauss-Newton with the adjoint's gradient, inner conjugate gradients on J^T J + alpha L (lagged
// diffusivity), started from the direct method. Boundary: the flat probe's face and the bonded bottom as
// measured, the sensor's traction for the scale. Says so if it has not settled after the budget's steps.
std::unique_ptr<ModulusMethod> make_iterative(Queue,
                                              std::shared_ptr<StripCache> = std::make_shared<StripCache>());

// T3.6: E <- E eps[E] / eps, eps[E] the axial strain of solid tissue under the rectangular face
// (ProbedSolid), with total variation on log E; tilt, and what is not stated of the face, fitted with it.
// The options are those with which the strain was measured.
std::unique_ptr<ModulusMethod> make_solid(const Queue&, const StrainOptions&,
                                          std::shared_ptr<StripCache> = std::make_shared<StripCache>());

}  // namespace teletact::service
