// A block of tissue on a bonded bottom, pressed by a flat, rigid face in its middle.
#pragma once

#include <Eigen/Core>

#include "bench/independent/hexahedra.h"

namespace teletact::bench {

// Lengths in m; x along the face, y into the tissue, z across the image plane, from the middle of the face.
struct Block {
  double width_m = .220, across_m = .190, depth_m = .040, modulus_pa = 10e3, poisson_ratio = .49;
  double face_width_m = .038, face_across_m = .008;
  bool bonded_face = true;  // else it slides without friction
  double push_m = .0004;
  double tilt = 0;  // the face's right end is pushed by tilt * face_width_m / 2 more
  double pad_m = 0, pad_contrast = 1;  // of the topmost layer
  double sphere_m = .010, sphere_depth_m = .015, contrast = 1;
  double true_modulus(double x_m, double y_m, double z_m = 0) const;
  bool operator==(const Block&) const = default;
};

class PressedBlock {
 public:
  // 10 to 18 s on one core. The force is some 0.2 % above that of finer meshes.
  explicit PressedBlock(const Block&);
  double force_n() const { return force_n_; }
  // Displacement in the image plane, (x, y), m, seen from the probe: its face rests.
  Eigen::Vector2d at(double x_m, double y_m) const;

 private:
  Block block_;
  Hexahedra mesh_;  // a quarter, x >= 0 and z >= 0
  // A push moves the block symmetrically, a tilt antisymmetrically in x.
  Eigen::Matrix3Xd pushed_m_, tilted_m_;
  double force_n_ = 0;
};

}  // namespace teletact::bench
