// What the chart says about a displacement, a strain and a modulus (T2.6, T3.3), the same for every method.
#pragma once

#include <cstdint>
#include <optional>
#include <vector>

#include "bench/basics/median.h"
#include "bench/peers/tracker.h"
#include "bench/phantoms/phantom.h"

namespace teletact::bench {

// Over the valid nodes at least 2 mm from the image's borders.
struct TrackErrors {
  double axial_rmse_m = 0, axial_p95_m = 0, axial_max_m = 0;
  double lateral_rmse_m = 0;  // NaN for a method that does not say
  double valid_fraction = 0;  // of all nodes in there
  double bias_m = 0;          // mean axial error
  double hop_fraction = 0;    // of all nodes: axially off by a quarter wavelength or more
};
TrackErrors track_errors(const Track&, const Phantom&);

// Standard deviation of (u - truth) / std over the valid nodes inside the inclusion and in the background (1
// mm from its border at least); NaN for a method that states none.
struct Calibration {
  double inside = 0, outside = 0;
};
Calibration standardised_errors(const Track&, const Phantom&);

// Axial strain by a plane fitted over kernel_axial_m x kernel_lateral_m (T2.4, rounded as the service does),
// NaN where less than 60 % of the kernel is valid. The same for every method.
std::vector<double> axial_strain(const Track&, double kernel_axial_m, double kernel_lateral_m);

// The true axial strain at the nodes.
std::vector<double> true_axial_strain(const service::ImageGrid&, const Phantom&);

// SNRe = |mean of the truth| / std of (estimate - truth) over background windows at the inclusion's depth,
// left and right of it: where the true strain is uniform that is mean / std (T2.6). CNRe = sqrt(2 (mt - mb)^2
// / (vt + vb)), vt and vb about the truth too. rmse: over the interior, of strain. NaN when less than half of
// a window says anything.
struct StrainQuality {
  double snre = 0, cnre = 0, rmse = 0, bias = 0;  // bias: of the window's mean over the true mean
};
StrainQuality strain_quality(const std::vector<double>& strain, const std::vector<double>& truth,
                             const service::ImageGrid&, const Phantom&);

// 20-80 % width (m) of the axial and the lateral blur: the Gaussian whose convolution with the true strain
// comes closest to `strain` (a mean over seeds) around the inclusion. NaN when there is no inclusion.
struct EdgeWidth {
  double axial_m = 0, lateral_m = 0;
};
EdgeWidth edge_width(const std::vector<double>& strain, const service::ImageGrid&, const Phantom&);

// T3.3: contrast = median over the inner 70 % of the radius over the background's median; Dice with Otsu's
// threshold on log E; background = median over the true background. NaN nodes say nothing. Over the nodes
// with judged != 0 (empty: all).
struct ModulusQuality {
  double contrast = 0, dice = 0, background = 0, valid_fraction = 0;
};
ModulusQuality modulus_quality(const std::vector<float>& modulus, const service::ImageGrid&, const Phantom&,
                               const std::vector<std::uint8_t>& judged = {});

// The nodes on which several maps are judged: those of which every map says something; within 1.3 radii of
// the inclusion all nodes, so that silence there counts against the method.
std::vector<std::uint8_t> judged_nodes(const std::vector<std::vector<float>>& maps, const service::ImageGrid&,
                                       const Phantom&);

// Threshold that splits values into two classes of the largest variance between them (Otsu 1979); NaN for
// fewer than two values.
double otsu_threshold(const std::vector<double>& values);

// Mean and half width of its 95 % interval (Student's t); half width NaN for fewer than two values.
struct Interval {
  double mean = 0, half_width = 0;
};
Interval interval95(const std::vector<double>& values);

}  // namespace teletact::bench
