// The stiffness of the tissue by layers of nodes, and its condensation onto one row (T4.2, T4.4).
//
// Ordered by rows of nodes, K is block tridiagonal: own blocks D_j, couplings E_j = K(j, j+1) that reach
// three nodes. With everything below row j eliminated, B_j = D_j - E_j B_{j+1}^-1 E_j^T; with everything
// above, A_j = D_j - E_{j-1}^T A_{j-1}^-1 E_{j-1}. Row j then sees the Schur complement A_j + B_j - D_j
// (above + own + below), whose inverse is the compliance among its nodes: exact, whatever the row. Cost per
// row: one dense symmetric inverse (m^3 flops, m = 2 nx) and O(m^2) for the sparse couplings.
// Ordered by columns K has the same form: column_condensation.h.
#pragma once

#include <Eigen/Core>

#include <cstddef>
#include <vector>

#include "service/tissue/grid.h"

namespace teletact::service {

// Dense algebra of eliminating one layer of nodes after the other (T4.2).
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

// Free nodes of the grid: those that no fixed edge holds. All bounds inclusive.
struct FreeNodes {
  std::size_t first_row = 0, last_row = 0, first_column = 0, last_column = 0;
  std::size_t rows() const { return last_row - first_row + 1; }
  std::size_t columns() const { return last_column - first_column + 1; }
};
// Throws std::invalid_argument when no edge is fixed (a free body has no compliance) or no node is free.
FreeNodes free_nodes(const TissueGrid&, const Supports&);

// The elements between two neighbouring layers of nodes.
class ElementLayer {
 public:
  // Nodes along the layer first: 0 and 1 on the layer before, 2 and 3 on the one after.
  using Stiffness = Eigen::Matrix<double, 8, 8>;
  // Free nodes of a layer, inclusive; the number of elements.
  ElementLayer(std::size_t first_node, std::size_t last_node, std::size_t count);
  void add(const Stiffness& element) { elements_.push_back(element); }
  // What they contribute to D of the layer before them, or of the one after.
  enum Neighbour { kBefore = 0, kAfter = 1 };
  void add_own(Neighbour, Eigen::MatrixXd& block) const;
  LayerCoupling coupling() const;  // E: rows the layer before

 private:
  template <class Add>
  void for_free_pairs(Add) const;
  std::size_t first_node_, last_node_;
  std::vector<Stiffness> elements_;
};

enum class Layers { kRows, kColumns };  // of nodes: what K is ordered by

// The block tridiagonal stiffness over free degrees of freedom: fixed layers and nodes are left out. A
// layer's freedoms are [u_x, u_y] of its nodes, from the left or from the top. Refers to grid and material.
class LayeredStiffness {
 public:
  // Of a grid and a material as validate() accepts them. Throws as free_nodes().
  LayeredStiffness(const TissueGrid&, const Material&, const Supports&, Layers);
  std::size_t layers() const;                               // fixed ones too
  std::size_t first_layer() const { return first_layer_; }  // free ones, inclusive
  std::size_t last_layer() const { return last_layer_; }
  Eigen::Index size() const { return Eigen::Index(2 * (last_node_ - first_node_ + 1)); }
  ElementLayer elements_after(std::size_t layer) const;  // between a layer and the next
  Eigen::MatrixXd own(std::size_t layer) const;          // D_j, size x size
  void add_own(std::size_t layer, Eigen::MatrixXd& block) const;

 private:
  const TissueGrid& grid_;
  const Material& material_;
  Layers layers_;
  std::size_t first_layer_ = 0, last_layer_ = 0, first_node_ = 0, last_node_ = 0;
};

// B_j of the first free row: its stiffness with all rows below it eliminated; the lower triangle. `kept`
// (may be null) gets B_j of every free row, in order, for condensed_rows.
Eigen::MatrixXd eliminated_below(const LayeredStiffness& rows, std::vector<Eigen::MatrixXd>* kept);
// A_j + B_j - D_j of every free row, in order; lower triangles. `below`: B_j of every free row where they
// are known, else empty.
std::vector<Eigen::MatrixXd> condensed_rows(const LayeredStiffness& rows, std::vector<Eigen::MatrixXd> below);

}  // namespace teletact::service
