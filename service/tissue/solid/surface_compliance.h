// Compliance of the surface of layered tissue (T8.1), or of a row of nodes below it, m/N, by the offset from
// the node that is pushed.
#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <vector>

#include "service/tissue/solid/solid_tissue.h"

namespace teletact::service {

class SurfaceCompliance {
 public:
  // Of a block of nx x nz columns: from the transformed compliance, [6][kz = 0 .. wide_z/2][pitch]
  // (row_symbol), of one that is at least as wide, up to offsets of half of the former.
  SurfaceCompliance(std::size_t nx, std::size_t nz, const std::vector<double>& symbol, std::size_t pitch,
                    std::size_t wide_x, std::size_t wide_z);
  // Displacement of component p under a unit force of component q, the first `dx`, `dz` nodes from the other.
  double operator()(std::size_t p, std::size_t q, long dx, long dz) const;
  // Among unknowns of the surface (SurfacePatch), each pair by the nearest of the period's copies.
  Eigen::MatrixXd among(const std::vector<std::size_t>& unknowns) const;
  // Of these unknowns under forces of those, the same way.
  Eigen::MatrixXd between(const std::vector<std::size_t>& moved,
                          const std::vector<std::size_t>& pushed) const;
  // Displacement of components first ... first + count - 1 of the whole surface, [component][z][x], under
  // forces of some of its unknowns.
  Eigen::VectorXd times(const std::vector<std::size_t>& unknowns, const Eigen::VectorXd& force_n,
                        std::size_t first, std::size_t count) const;

 private:
  struct Place;
  std::vector<Place> places_of(const std::vector<std::size_t>& unknowns) const;
  double between(const Place& moved, const Place& pushed) const;
  std::size_t nx_, nz_;
  std::vector<double> table_;  // [xx, xy, xz, yy, yz, zz][z][x]
};

// The same for tissue so wide that its period, at least `min_period_m`, is not felt; `smooth_m`: of what is
// left of it once forces are smeared by a Gaussian of this deviation; `row`: of nodes, 0 the surface.
SurfaceCompliance wide_surface(const SolidGrid&, const LayeredTissue&, double poisson_ratio,
                               double min_period_m, double smooth_m = 0, std::size_t row = 0);

}  // namespace teletact::service
