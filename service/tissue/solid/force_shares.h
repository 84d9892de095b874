// What the elements of layered tissue bear of the force of a contact on its surface (T9.2), and how stiff
// tissue beside it is felt by that.
//
// u the field of the contact, z that of a unit push on the same nodes: g_e = z . K_e u is element e's share
// of F = z . K u. To first order ln F changes by sum g_e ln(E_e / E0) / F.
#pragma once

#include <Eigen/Core>
#include <functional>
#include <vector>

#include "service/tissue/solid/element_shares.h"
#include "service/tissue/solid/solid_tissue.h"

namespace teletact::service {

// Of contacts of each of these radii, about each node: sum g ln(E / E0), and the variance of ln(E / E0) with
// these shares, which the sum is off by the more, the larger it is.
class FeltForce {
 public:
  struct At {
    double log_mean = 0, log_variance = 0;
    double by_log_radius = 0;     // derivative of log_mean by ln a
    Eigen::Vector2d slope{0, 0};  // of log_mean by x and z, 1/m
    Eigen::Matrix2d curvature = Eigen::Matrix2d::Zero();
  };
  FeltForce(const SolidGrid&, std::vector<double> radius_m, std::vector<Eigen::VectorXd> log_mean,
            std::vector<Eigen::VectorXd> log_variance);
  // Over all nodes, of contacts of the table's radii on both sides of this one.
  double max_log_variance(double radius_m) const;
  // About (x, z) of the block, for contacts of this radius, the next one of the table beyond its ends.
  // Smooth: cubics through the nodes and over ln a.
  At at(double x_m, double z_m, double radius_m) const;

 private:
  std::size_t nx_, nz_;
  double spacing_x_m_, spacing_z_m_;
  std::vector<double> log_radius_;
  std::vector<Eigen::VectorXd> mean_, variance_;
};

class ForceShares {
 public:
  // Forces on unknowns of the surface (SurfacePatch) about node 0, N, 1 in all: Hertz's pressure and that
  // under a flat punch, of the same radius.
  struct Contact {
    std::vector<std::size_t> unknowns;
    Eigen::VectorXd hertz_n, punch_n;
  };
  static std::vector<double> radii_m(const SolidGrid&);
  static Contact contact(const SolidGrid&, double radius_m);
  // `solve`: the layered tissue's field under such forces, [plane = 3 row + component][z][x].
  using Solve =
      std::function<std::vector<float>(const std::vector<std::size_t>& unknowns, const Eigen::VectorXd&)>;
  ForceShares(const Queue&, const SolidGrid&, const LayeredTissue&, double poisson_ratio, const Solve&);
  // Of tissue beside these layers, whose E0 is theirs over `softer`.
  FeltForce felt(const SolidTissue&, double softer = 1);

 private:
  SolidGrid grid_;
  std::vector<double> layers_pa_, radius_m_;
  ElementMeans means_;
  std::vector<ElementMeans::Map> shares_;  // of each radius
};

}  // namespace teletact::service
