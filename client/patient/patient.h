// The simulated patient: quasi-static plane-strain FEM of the tissue in double precision, the truth that the
// service's estimate is judged by. Bottom bonded, sides and the untouched surface free.
// All const members may be called from several threads at once.
#pragma once

#include <Eigen/Core>
#include <array>
#include <memory>

#include "client/patient/column_solver.h"
#include "client/patient/mesh.h"
#include "client/patient/tissue.h"

namespace teletact::client {

// The flat probe pressed into the tissue by `compression_m`.
struct ProbeState {
  double window_x_m = 0;  // left end of its face, scene coordinates
  double window_z_m = 0;  // of its middle, the image plane; of a solid
  double width_m = 0;
  double compression_m = 0;  // of its middle
  double tilt = 0;           // beside it the face goes down by compression_m + tilt (x - middle)
  double force_n = 0;        // true sensor force, > 0 in compression: reaction per metre x elevation
  double contact_area_m2 = 0;
  std::shared_ptr<const DisplacementField> field;  // LAB displacement over the whole tissue

  // Of the probe and all that is fixed to it, at a point: what its PROBE frame takes off.
  DisplacementField::Vector motion(double x_m, double y_m) const {
    return {-tilt * y_m, compression_m + tilt * (x_m - window_x_m - width_m / 2), 0};
  }
};

enum class FingerShape { kNode, kFlatPunch, kRoundedTip };

// Frictionless rigid fingertips (T4.3). Profile: how much less than the indentation it prescribes at distance
// d from its centre: rounded tip d^2 / 2R; flat punch 0 inside half_width_m, (|d| - half_width_m)^2 / 2R
// outside.
struct Finger {
  FingerShape shape = FingerShape::kRoundedTip;
  double radius_m = 0.008;
  double half_width_m = 0.004;  // flat punch
  double footprint_m = 0;       // node: standard deviation of a Gaussian footprint, 0 = the hat function
};

struct TouchForce {
  std::array<double, 2> force_n{};  // on the finger: F = -dU/d(x, indentation); force_n[1] <= 0
  double energy_j = 0;              // U
  std::size_t contact_nodes = 0;
  double contact_width_m = 0;  // between the outermost nodes in contact
};

class Patient {
 public:
  static constexpr double kSpacing = 0.0005;

  // Factors the tissue and its surface compliance. Throws TissueError.
  explicit Patient(Tissue tissue, double spacing_m = kSpacing);

  const Tissue& tissue() const { return tissue_; }
  const PatientMesh& mesh() const { return mesh_; }
  // Normal compliance among all surface nodes, m per N per metre of thickness (T4.2).
  const Eigen::MatrixXd& surface_compliance() const { return compliance_; }

  // The probe's face covers [window_x_m, window_x_m + probe.width_m]; every surface node under it is pressed
  // down by compression_m, free to slide. Throws std::invalid_argument when it reaches beyond the tissue or
  // compression_m is not in (0, depth / 10].
  ProbeState press(double window_x_m, double compression_m) const;

  // True unilateral contact force at a pose: U = max over pressures p >= 0 of p.w - p.S p / 2 over all nodes
  // near the tip (T4.2 to T4.5b), times thickness_m. indentation_m <= 0: no force. Throws
  // std::invalid_argument for x outside the tissue, an indentation deeper than it, or an unusable finger.
  TouchForce touch(const Finger& finger, double x_m, double indentation_m) const;

 private:
  TouchForce touch_node(const Finger& finger, double x_m, double indentation_m) const;
  TouchForce touch_tip(const Finger& finger, double x_m, double indentation_m) const;

  Tissue tissue_;
  PatientMesh mesh_;
  ColumnSolver solver_;
  Eigen::MatrixXd compliance_;
};

// What the probe's force sensor reads: the force by its gain and zero, and relative and absolute noise, both
// Gaussian (Probe).
double sensed_force(const Probe& probe, double true_force_n, std::uint64_t seed);

}  // namespace teletact::client
