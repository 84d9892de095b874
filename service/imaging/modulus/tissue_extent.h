// Statements about the tissue under the probe, beside its frames: force, extent, plane, modulus of its
// neighbourhood.
#pragma once

#include <Eigen/Core>
#include <cmath>
#include <functional>
#include <optional>
#include <vector>

namespace teletact::service {

// Force sensor of the probe: resisting force (N, > 0 in compression) over the probe's contact area. Absent:
// the modulus is relative (T3), or a pad's.
struct ProbeForce {
  double force_n = 0;
  double contact_area_m2 = 0;
  // Standard deviations of ln(force / area): of what is another for each pair (the sensor's noise, its zero),
  // and of what pairs have in common (its gain, the area, the preload).
  double own_deviation = 0, shared_deviation = 0;
  double deviation() const { return std::hypot(own_deviation, shared_deviation); }
};

// Strain of the tissue across the image plane: none (thick tissue between its neighbours), whatever leaves
// it free of stress there (a thin slice), or what a narrow probe on wide tissue makes it do.
enum class Plane { kStrain, kStress, kSolid };

// What is known of ln E in the topmost millimetres, in which no strain is measured, over that below.
struct Surface {
  enum class Kind { kUnknown, kBare, kCapsule, kUneven };
  Kind kind = Kind::kUnknown;
  double thickness_m = 0, ratio = 0;  // of a capsule, and of its modulus to that below; their deviations
  double thickness_std_m = 0, ratio_std = 0;
};

// A stand-off pad of known modulus between face and tissue, which goes on around the face, with the standard
// deviations of both: a force sensor where the probe has none.
struct StandoffPad {
  double thickness_m = 0, youngs_modulus_pa = 0;
  double thickness_std_m = 0, youngs_modulus_std_pa = 0;
};

// Where the window [window_x_m, window_x_m + lines * pitch) lies in its tissue: [0, width_m] x [0, depth_m],
// y = 0 at the probe face, bonded below, free sides (T4).
struct TissueExtent {
  // Beyond it the force's slope over nu is lost in rounding, and with it whether the modulus hangs on nu.
  static constexpr double kLargestPoissonRatio = 0.49999;
  double width_m = 0, depth_m = 0, window_x_m = 0;
  double poisson_ratio = 0.49;  // 0 <= nu <= kLargestPoissonRatio
  Plane plane = Plane::kStrain;
  // Where plane is kSolid: length of the probe's face across the image, 0 where it is not known; whether
  // depth_m is known. What is not known is fitted.
  double probe_elevation_m = 0;
  bool depth_stated = true;
  double doubted_depth_m = 0;  // that is stated, but not believed: depth_m is how deep there is strain
  double surface_m = 0;        // below the face, under coupling: depth_m is told from there
  // Standard deviations of what is stated; 0: taken as stated, of a solid as its fit usually takes it.
  double probe_elevation_std_m = 0;
  double depth_std_m = 0;
  // How far tissue goes on beside the face, on both sides; absent: not stated.
  std::optional<double> beside_m = {};
  double beside_std_m = 0;
  double poisson_std = 0;
  Surface surface = {};
  std::optional<StandoffPad> pad = {};  // of a solid: the first part of depth_m
};

// Young's modulus (Pa) that other windows, or this one before, have told at x_m (tissue coordinates) and
// depth y_m, NaN where unknown, and the standard deviation of its logarithm, NaN where that is not known.
// Tissue beyond the window's borders draws stress to itself and so shows in the window.
struct KnownModulus {
  std::function<double(double x_m, double y_m)> modulus_pa = {}, log_deviation = {};
  double operator()(double x_m, double y_m) const { return modulus_pa(x_m, y_m); }
  explicit operator bool() const { return static_cast<bool>(modulus_pa); }
};
inline const KnownModulus kNothingKnown;

// Young's modulus (Pa) in another image plane of the same solid, offset_m across this one, at x_m of the
// window and depth y_m below the probe's face; NaN where unknown.
struct SliceBeside {
  double offset_m = 0;
  std::function<double(double x_m, double y_m)> modulus_pa;
};

// What the strain of a slice tells of the tissue that all slices of a solid share (T3.9): one kind of it.
struct ToldTissue {
  // What ends beside the probe and whether it slides (kind_of()), and where it ends: in 1/100 of the depth,
  // -1 where that is stated.
  int ends = 0, slides = 0, place = 0;
  double log_likelihood = 0;  // over that of the likeliest
  // By that strain alone, of ln of the face's elevation, of the depth (m), then of the skin's changes: the
  // inverse of the covariance, and its product with the mean. Empty: nothing is told.
  Eigen::MatrixXd information = {};
  Eigen::VectorXd load = {};
  // Where its fit leads, or where it was solved if that is near: the face, the depth, how far beside the face
  // it ends; 0: not known. The next slice begins there.
  double elevation_m = 0, depth_m = 0, beside_m = 0;
};
struct ToldBeside {
  double offset_m = 0;  // across the image
  std::vector<ToldTissue> tissues;
};

}  // namespace teletact::service
