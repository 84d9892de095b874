// Shares that the elements of layered tissue have in the work of a contact about node 0, and what a map over
// the elements is in the mean, with these shares, about each node of the surface: correlations, by Fourier
// transforms.
#pragma once

#include <Eigen/Core>

#include <cstddef>
#include <functional>
#include <utility>
#include <vector>

#include "service/device/device.h"
#include "service/solver/fourier.h"
#include "service/tissue/solid/solid_tissue.h"

namespace teletact::service {

// z . K_e u of each element, [layer][z][x]; u and z: fields, [plane = 3 row + component][z][x]. `mirrored`:
// tissue and fields are alike on both sides of node 0, along x and along z; a quarter is then looked at.
template <class T>
std::vector<double> work_of_elements(const SolidTissue&, const std::vector<T>& u, const std::vector<T>& z,
                                     bool mirrored = false);

// One thread at a time, as its queue.
class ElementMeans {
 public:
  // The transform of a map over the elements.
  using Map = std::vector<float>;
  // at_once: so many means at most.
  ElementMeans(const Queue&, const SolidGrid&, std::size_t at_once = 1);
  Map transformed(const std::vector<float>& of_elements);
  // Of the elements' shares in z . K u, 1 in all; tissue and fields mirrored, as above.
  template <class T>
  Map shares(const SolidTissue& layers, const std::vector<T>& u, const std::vector<T>& z);
  // About each node of the surface, [z][x]: sum over e of share_e map_(e + node).
  Eigen::VectorXd means(const Map& shares, const Map& map);
  // Of each pair of shares and a map, at once.
  std::vector<Eigen::VectorXd> means(const std::vector<std::pair<const Map*, const Map*>>&);

 private:
  Queue queue_;
  std::size_t layers_;
  Fourier<float> elements_, surface_;
  Array<float> field_, spectrum_, plane_, sum_;
};

// How stiff tissue is where its surface is touched, about (T8.4): ln(E / E0) of what lies around and below a
// node, weighted by the share of the energy that a contact there leaves in it, were the tissue layered. S0
// with its smooth part scaled by that, S0 + D S_l D - S_l, is nearer to S than S0.
// Of each node of the surface, [z][x].
struct FeltModulus {
  // D = exp(-m/2), m the mean of ln(E / E0): exactly 1 where all tissue is layered.
  Eigen::VectorXd scale;
  // What that may be off by there over itself: the same shares bound S between the mean of E0 / E (stress
  // as it is in layered tissue) and one over that of E / E0 (strain as it is there).
  Eigen::VectorXd beyond;
};

// The shares, of a factor's layers; one thread at a time, as its queue.
class EnergyShares {
 public:
  // A usual contact, Hertz's pressure of radius 4 mm about node 0, by unknown of the surface (SurfacePatch).
  struct Load {
    std::vector<std::size_t> unknowns;
    Eigen::VectorXd force_n;
  };
  static Load usual_load(const SolidGrid&);
  // `displacement_m`: of layered tissue under the usual load, [plane = 3 row + component][z][x].
  EnergyShares(const Queue&, const SolidGrid&, const LayeredTissue&, double poisson_ratio,
               const std::vector<double>& displacement_m);
  // Of tissue beside these layers, whose E0 is theirs over `softer`.
  FeltModulus felt(const SolidTissue&, double softer = 1);

 private:
  std::size_t columns_;
  std::vector<double> layers_pa_;
  ElementMeans means_;
  ElementMeans::Map shares_;
};

// What the elements of layered tissue bear of the force of a contact on its surface (T9.2), and how stiff
// tissue beside it is felt by that.
//
// u the field of the contact, z that of a unit push on the same nodes: g_e = z . K_e u is element e's share
// of F = z . K u. To first order ln F changes by sum g_e ln(E_e / E0) / F.
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
