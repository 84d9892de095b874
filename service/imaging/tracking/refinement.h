// One regularised Gauss-Newton step over the whole image (T2.3), kernels/refinement.cl: every node's pixels
// against the deviation of its displacement gradient from the local mean, as one system of a 2x2 block per
// node, solved by conjugate gradients.
//
//   minimise  sum_n (y_n - u_n) . h_n (y_n - u_n)  +  sum over edges  w (D u - <D u>)^2
//
// h: information of the node's pixels, 1 / variance of the displacement y that they alone would give (so the
// units are those of a posterior). <D u>: gradient averaged over kGradientRadius nodes to each side in the
// field before the step, so that uniform strain is not biased and neither is one that changes slowly.
#pragma once

#include <array>
#include <memory>
#include <optional>
#include <vector>

#include "service/device/device.h"
#include "service/imaging/tracking/node_gradients.h"
#include "service/imaging/tracking/noise_model.h"
#include "service/imaging/tracking/sample_grid.h"
#include "service/solver/pcg.h"

namespace teletact::service {

inline constexpr int kGradientRadius = 3;
inline constexpr int kRefinementSteps = 3;  // of a field, each with its own pair
// The linear solve of the last step; the steps before it may leave three times the residual. 15 to 30
// iterations are usual.
inline constexpr PcgOptions kRefinementSolve{
    .relative_error = 0, .relative_residual = 3e-2, .max_iterations = 200};

struct ImagePair {
  const Array<float>&mean, &difference;  // padded
  ImageLayout layout;
  int samples = 0, lines = 0;
};

// How the noise of a displacement estimate is spread and correlated, lateral [0] and axial [1].
struct NoiseStructure {
  std::array<NoiseResponse, 2> response;  // of displacement in lines, samples
  std::array<double, 2> unit_m{};         // a line, a sample
};

class Refinement {
 public:
  Refinement(const Queue&, const PcgOptions&, const SampleGrid&, double line_pitch_m, double sample_pitch_m);
  ~Refinement();
  // Reads a motion-compensated pair: noise, correlation per node (-2: no texture) and information; robust:
  // pixels far off weigh less, and what companding makes of the pulse is taken off the noise (T2.3d,
  // kernels/pulse.cl).
  Autocorrelations measure(const ImagePair&, bool robust, Array<float>& correlation);
  // From what was measured last: out = field + correction, at most `lateral_limit` lines and `axial_limit`
  // samples. `number`: of the steps, from 0 on. Reads nothing.
  void step(const Array<float>& field, Array<float>& out, float lateral_limit, float axial_limit, int number);
  // After all steps: standard deviation (m) and information averaged over the estimator's footprint, 2 per
  // node, of the final field, the bias by smoothing included.
  struct Uncertainty {
    std::shared_ptr<const NoiseStructure> noise;
    std::optional<PcgResult> unsolved;  // the last step whose linear solve did not end well
  };
  Uncertainty uncertainty(const Array<float>& field, Array<float>& information, Array<float>& deviation_m);
  // The last step's, each lateral, axial: weights of the edges along i, of those along j, spread and
  // sensitivity of the noise, median information, smoothing length (m); then how the solves ended.
  static constexpr std::size_t kModel = 12;
  std::vector<float> model() const { return queue_.read(model_); }
  static PcgResult solved(const std::vector<float>& model, int number);

 private:
  struct Kernels;
  Autocorrelations added_up() const;
  void add_terms(const ImagePair&);
  void gather(const ImagePair&, bool robust, Array<float>& correlation);
  void weigh(const Array<float>& field);
  void look_up(const NoiseStructure&, const std::vector<int>& radii, Array<float>& information,
               Array<float>& deviation_m);

  Queue queue_;
  PcgOptions options_;
  SampleGrid grid_;
  double line_pitch_m_, sample_pitch_m_, dx_m_, dy_m_;
  NodeGradients gradients_;
  std::size_t group_, width_;  // of the group that finds the medians
  std::shared_ptr<Kernels> kernels_;
  int chunks_ = 1;
  Array<float> hat_, noise_, terms_, pixels_, pulses_, gradient_, strain_, model_, diagonal_, cross_, rhs_,
      correction_, information_, pull_, bias_;
  Array<float> products_;
  std::vector<float> product_sums_;  // as they were read
};

}  // namespace teletact::service
