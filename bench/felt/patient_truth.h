// The force of a simulated solid patient's own tissue: its modulus at each element, nodes 1 mm apart at other
// places than any scene's, more tissue around, in double, each pose solved anew.
#pragma once

#include <Eigen/Core>

#include <functional>

#include "bench/independent/touched_block.h"
#include "client/patient/solid_patient.h"
#include "client/patient/tissue.h"
#include "service/contact/solid_contact.h"

namespace teletact::bench {

// Young's modulus (Pa) anywhere, in a scene's coordinates, and what holds it.
struct TrueSolid {
  double middle_x_m = 0;  // of what is touched
  double depth_m = 0, poisson_ratio = 0;
  std::function<double(double x_m, double y_m, double z_m)> modulus_pa;
  std::function<double(double y_m)> layered_pa;  // without lumps and texture
  double bed_m = 0;                              // below depth_m, bonded to rigid ground
  bool slides = false;                           // on its bottom
  Sides sides{};                                 // free
};
// What it is made of must outlive it and its copies.
TrueSolid true_solid(const client::SolidPatient&);
// As `acquire --slices` makes a scene of it: x from the left border of what the probe images, on its middle.
// Of an element 1 mm wide the mean over eight points.
TrueSolid true_solid(const client::Tissue&);

// On the patient's own support; tissue continues where its sides end, which elements of 20 nodes do not
// take for granted.
class PatientTruth {
 public:
  static constexpr double kForceError = 1e-3;  // of the force, what its solver states
  PatientTruth(const service::Queue&, const TrueSolid&, const service::Fingertip&);
  struct Force {
    Eigen::Vector3d force_n;
    // Of layered tissue there: force on the truth's nodes over that on ever finer ones, which is taken off.
    double nodes = 1;
  };
  // At [x, indentation, z] in the patient. Throws BenchError where it is not known.
  Force at(const service::Vector3& position_m);

 private:
  // A block of nodes, and where its node (0, 0) lies in the patient.
  struct Place {
    service::SolidGrid grid;
    double x_m = 0, z_m = 0;
    service::Vector3 in_block(const service::Vector3& pose) const {
      return {pose[0] - x_m, pose[1], pose[2] - z_m};
    }
  };
  static Place nodes(const TrueSolid&);
  static Place finest_nodes(const TrueSolid&, const service::Vector3& pose);
  double layered_n(service::SolidContact<double>&, const service::Vector3& in_block) const;
  const service::Queue queue_;
  const service::Fingertip tip_;
  const TrueSolid solid_;
  const Place nodes_;
  const service::SolidTissue tissue_;
  const service::SolidContact<double> base_;
  service::SolidContact<double> layers_, finest_layers_;
};

}  // namespace teletact::bench
