// The forward model of the Gauss-Newton peer: plane strain on squares of 1.5 mm under the window, coarser
// beside it, the modulus constant on patches of 3 mm (beside the window: the nearest one's), the probe's face
// pressed down by 1 m without friction, the bottom bonded, the rest free.
#pragma once

#include <Eigen/Core>
#include <Eigen/SparseCholesky>
#include <vector>

#include "service/imaging/modulus/tissue_extent.h"
#include "service/tissue/grid.h"

namespace teletact::bench {

class PatchForward {
 public:
  PatchForward(const service::TissueExtent&, double window_width_m, double window_depth_m);

  int patches_x() const { return patches_x_; }
  int patches_y() const { return patches_y_; }
  std::size_t patches() const { return patch_.size(); }
  // Patches that are side by side.
  std::vector<std::pair<std::size_t, std::size_t>> neighbours() const;
  // Points of the window (x from its left end) where `response` says the displacement.
  struct Point {
    double x_m = 0, y_m = 0;
  };
  const std::vector<Point>& points() const { return points_; }
  double patch_m() const;

  struct Response {
    Eigen::VectorXd axial;     // u_y - 1 at the points: in the PROBE frame
    double force_n_per_m = 0;  // on the face
  };
  // Modulus (Pa) of every patch.
  Response respond(const Eigen::VectorXd& modulus);

 private:
  using Sparse = Eigen::SparseMatrix<double>;
  // Of one patch of unit modulus.
  struct Patch {
    std::vector<std::pair<Eigen::Index, double>> entries;  // position in stiffness_'s values, value
    Eigen::VectorXd pushed;                                // K 1_face, over all degrees of freedom
  };
  struct Entry {
    std::size_t patch;
    Eigen::Index row, column;  // degrees of freedom
    double value;
  };
  std::vector<Entry> entries_of(const service::TissueExtent&, double window_width_m, double window_depth_m);
  void hold(const service::TissueExtent&, double window_width_m);
  void place(const std::vector<Entry>&);

  service::TissueGrid grid_;
  int patches_x_ = 0, patches_y_ = 0;
  std::vector<Patch> patch_;
  std::vector<Eigen::Index> free_;  // number among the free degrees of freedom, -1 for held
  std::vector<std::size_t> face_;   // degrees of freedom that are 1
  std::vector<Point> points_;
  std::vector<std::size_t> point_dof_;
  Sparse stiffness_;  // of the free ones
  Eigen::SimplicialLDLT<Sparse> factor_;
};

}  // namespace teletact::bench
