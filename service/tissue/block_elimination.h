// Dense algebra of eliminating one layer of nodes after the other (T4.2).
#pragma once

#include <Eigen/Core>

namespace teletact::service {

// Replaces the lower triangle of the symmetric positive definite `a` by that of its inverse, by recursive
// 2x2 blocks (all work in matrix products); the upper triangle is left alone. Throws std::domain_error when a
// pivot is not positive or not finite.
void invert_symmetric(Eigen::Ref<Eigen::MatrixXd> a);

// Replaces `a` = L L^T, of which the lower triangle is read, by L^-1. Throws as invert_symmetric().
void invert_factor(Eigen::Ref<Eigen::MatrixXd> a);

// A block that couples every node of one layer to three nodes of a neighbouring one: row 2 i + a holds the
// entries towards the degrees of freedom 2 (i-1) ... 2 (i+1) + 1; what falls outside is zero.
struct LayerCoupling {
  Eigen::Matrix<double, Eigen::Dynamic, 6, Eigen::RowMajor> band;
  LayerCoupling transposed() const;
};

// Matrices as large as a layer's, kept from layer to layer: fresh ones cost as much in page faults as the
// work.
struct LayerWorkspace {
  explicit LayerWorkspace(Eigen::Index size) : a(size, size), b(size, size) {}
  Eigen::MatrixXd a, b;
};

enum class Part { kWhole, kLower };

// product = sign x E^T, of the size of x; for kLower only what lies on or below the 2x2 blocks of the
// diagonal, and the rest of `product` is left alone.
void times_transposed(const Eigen::MatrixXd& x, double sign, const LayerCoupling& e, Part,
                      Eigen::MatrixXd& product);

// change = -E neighbour^-1 E^T, its lower triangle. The lower triangle of `neighbour` is read, and becomes
// its whole inverse.
void eliminate(Eigen::MatrixXd& neighbour, const LayerCoupling& e, LayerWorkspace&, Eigen::MatrixXd& change);

}  // namespace teletact::service
