// Displacement of tissue between two RF frames (T2): post(x + u) = pre(x), on OpenCL
// (kernels/search.cl, displacement.cl).
//
// Coarse to fine, each level companding post with the displacement of the one before:
//   1. normalised cross-correlation over all axial lags and, a beam width apart, all lateral lags that the
//      largest strain allows, 1 mm x 2 mm nodes; paths that neighbours can reach (find_paths) cure peak hops
//      before they happen;
//   2. search of a quarter period axially and of half of kLateralSearchM around that, 1 mm x 1 mm nodes;
//   3. Gauss-Newton on interpolated RF, axial and lateral together, on the image grid, regularised over the
//      whole image (T2.3, refinement.h).
// What holds no echo in either frame (echoes.h) counts as what lies outside of them. Between the levels
// outliers give way to the median of their neighbours. The last step runs on frames passed through the
// matched filter of noise_model.h.
#pragma once

#include <memory>
#include <optional>

#include "service/base/choices.h"
#include "service/device/device.h"
#include "service/imaging/tracking/echoes.h"
#include "service/imaging/tracking/frame.h"
#include "service/imaging/tracking/refinement.h"
#include "service/imaging/tracking/sample_grid.h"

namespace teletact::service {

// Locally 1.6 times as much is searched, and frames are warped by 0.2 at most.
inline constexpr double kLargestMaxStrain = 0.125;
inline constexpr double kLateralSearchM = 0.8e-3;               // magnitude, on the middle line
inline constexpr double kGridDxM = 0.45e-3, kGridDyM = 0.4e-3;  // rounded to whole lines and samples
inline constexpr double kFineWindowAxialM = 1.6e-3, kFineWindowLateralM = 1.2e-3;
inline constexpr double kCoarseWindowAxialM = 0.8e-3, kCoarseWindowLateralM = 2.0e-3;
inline constexpr double kTrustedCorrelation = 0.7;  // below it a node is not trusted

struct DisplacementOptions {
  PcgOptions refinement = kRefinementSolve;
  // Magnitude of the mean compression; bounds the axial and the lateral search.
  double max_strain = choices::kMaxStrain;
};

// On the device, index i + nx j.
struct DisplacementEstimate {
  SampleGrid grid;
  Array<float> field_m;      // 2 per node: lateral, axial
  Array<float> correlation;  // of pre and motion-compensated post, -1 .. 1; -2: no texture
  // Correlation and deviation from the neighbours within their limits, echoes all about, and inside of the
  // frame and what holds echoes after the motion too.
  Array<std::uint8_t> trusted;
  Array<float> std_m = {};        // standard deviation, 2 per node: lateral, axial
  Array<float> information = {};  // 2 per node, of the place: what `noise` turns into standard deviations
  std::shared_ptr<const NoiseStructure> noise = nullptr;
  // The last step whose linear system was not solved: the field is then not the best that the pair gives, and
  // its deviation too small. Empty: all were.
  std::optional<PcgResult> unsolved = {};
};

// Not thread-safe: one queue, buffers kept for the next pair of the same geometry.
class DisplacementEstimator {
 public:
  // Throws std::invalid_argument for an unusable max_strain. What it allocates is charged to the queue's
  // account.
  DisplacementEstimator(Queue, DisplacementOptions);
  ~DisplacementEstimator();
  // Throws std::invalid_argument where the coarse search of such frames would not fit in memory. Allocates
  // nothing and reads no sample: the frames may be empty.
  static void require_fits(const RfFrame&, const AcquisitionGeometry&, const DisplacementOptions&);
  void set_max_strain(double);
  void forget();  // the buffers that are kept for the next pair
  // `pre`, `post`, `geometry` as validate() accepts them. The result's arrays are overwritten by the next
  // call.
  DisplacementEstimate estimate(const RfFrame& pre, const RfFrame& post,
                                const AcquisitionGeometry& geometry) {
    return estimate(pre, post, geometry, find_echoes(pre, geometry), 0);
  }
  // The echoes of `pre` are known, and of no sample before `first` anything is believed.
  DisplacementEstimate estimate(const RfFrame& pre, const RfFrame& post, const AcquisitionGeometry&,
                                const Echoes& of_pre, int first);

 private:
  struct Workspace;
  struct Kernels;
  void search();
  void refine();
  void filter_frames(const Autocorrelations&);
  void warp(const SampleGrid&, bool pair);
  Range over_samples(int run) const;

  Queue queue_;
  DisplacementOptions options_;
  std::unique_ptr<Kernels> kernels_;
  std::unique_ptr<Workspace> work_;
};

}  // namespace teletact::service
