// The tissue grid: a rectilinear mesh of bilinear quadrilaterals (Q1), lines of nodes at given coordinates.
// Node (i, j) lies at (x_m[i], y_m[j]) and has index i + nx j; j = 0 is the natural surface (y = 0), y points
// into the tissue. Element (i, j) lies between nodes (i, j) and (i+1, j+1), index i + (nx-1) j.
// Degree of freedom of node n: 2 n (lateral, u_x) and 2 n + 1 (axial, u_y).
#pragma once

#include <cstddef>
#include <string>
#include <vector>

namespace teletact::service {

struct TissueGrid {
  std::vector<double> x_m;  // strictly increasing, >= 2
  std::vector<double> y_m;  // strictly increasing from 0, >= 2
  std::size_t nx() const { return x_m.size(); }
  std::size_t ny() const { return y_m.size(); }
  std::size_t nodes() const { return nx() * ny(); }
  std::size_t elements() const { return (nx() - 1) * (ny() - 1); }
  std::size_t dofs() const { return 2 * nodes(); }
  std::size_t node(std::size_t i, std::size_t j) const { return i + nx() * j; }
  std::size_t element(std::size_t i, std::size_t j) const { return i + (nx() - 1) * j; }
};

// Grid columns, both ends included.
struct ColumnRange {
  std::size_t first = 0, last = 0;
  std::size_t size() const { return last - first + 1; }
  bool operator==(const ColumnRange&) const = default;
};

// Position of `column` in the range; throws std::out_of_range when it is outside.
std::size_t position_among(std::size_t column, ColumnRange);

enum class EdgeSupport { kFree, kFixed };  // kFixed: both components zero

struct Supports {
  EdgeSupport top = EdgeSupport::kFree, bottom = EdgeSupport::kFixed;
  EdgeSupport left = EdgeSupport::kFree, right = EdgeSupport::kFree;
  bool operator==(const Supports&) const = default;
};

// Linear isotropic elasticity in plane strain (T4), nearly incompressible allowed: 2 mu eps:eps integrated
// fully (2x2), lambda (div u)^2 at the element centre.
struct Material {
  std::vector<double> youngs_modulus_pa;  // one per element, > 0
  double poisson_ratio = 0.49;            // 0 <= nu < 0.5, one value
};

// Throws std::invalid_argument with the message unless the condition holds.
void require(bool condition, const std::string& message);

// The cell of increasing coordinates that holds a position; beyond both ends the outermost.
std::size_t cell_of(const std::vector<double>& coordinates, double at);

// Throws std::invalid_argument naming the field when the grid, the material or their sizes are unusable.
void validate(const TissueGrid&);
void validate(const TissueGrid&, const Material&);

// `count` + 1 equally spaced coordinates over [begin, end].
std::vector<double> uniform_coordinates(double begin_m, double end_m, std::size_t count);

// Coordinates that are `fine_m` apart over [fine_begin, fine_end] and grow by `ratio` up to `coarse_m`
// outside, covering exactly [begin, end].
std::vector<double> graded_coordinates(double begin_m, double end_m, double fine_begin_m, double fine_end_m,
                                       double fine_m, double coarse_m, double ratio);

}  // namespace teletact::service
