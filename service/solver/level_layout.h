// Where multigrid's levels lie in its arrays on the device (kernels/levels.clh): a plane holds one number for
// each node of a level, with a column of zeros between rows and a margin of zeros around.
#pragma once

#include <cstddef>
#include <vector>

namespace teletact::service {

// Lines of nodes in one direction and their coarsening: every second line plus the last, so that any number
// of lines at any spacing works.
// Strictly increasing coordinates of the node lines, >= 2 each.
struct NodeLines {
  std::vector<double> x, y;
  std::size_t nodes() const { return x.size() * y.size(); }
};

// Linear interpolation between the lines of a fine and a coarse level.
struct LineTransfer {
  std::vector<double> coarse;  // coordinates of the coarse lines
  std::vector<int> at;         // fine line of each coarse line
  std::vector<double> around;  // for each coarse line: weights of the fine lines just before and after it
  std::vector<int> left;       // coarse line at or before each fine line
  std::vector<double> weight;  // of coarse line left + 1 in each fine line
};

// Drops every second line as long as the interval left by it does not exceed `widest`: where lines already
// lie far apart, all are kept.
LineTransfer coarsen(const std::vector<double>& fine, double widest);

// The next coarser level in both directions. `spacing` is the fine level's nominal distance of lines, doubled
// until something coarsens; intervals grow to at most kWidestInterval times it. So stretched elements are
// coarsened across their short side first, until they are square: point smoothers fail on stretched ones.
struct GridTransfer {
  LineTransfer x, y;
};
GridTransfer coarsen(const NodeLines& fine, double& spacing);
constexpr double kWidestInterval = 3;

// Every second line of both directions, whatever the spacing.
GridTransfer coarsen_fully(const NodeLines& fine);

// Direction of the short side of elements, when some are stretched by more than kStretched one way and none
// is the other way.
enum class ShortSide { kNeither, kX, kY };
ShortSide short_side(const NodeLines&);
constexpr double kStretched = 2;

// Smallest distance between neighbouring lines of either direction.
double smallest_spacing(const NodeLines&);

// The steps of one multigrid cycle, in order, and the coefficients of those that smooth.
// As in kernels/multigrid.cl.
enum class CycleStep : int {
  kResidual,        // residual = right - A correction
  kSmooth,          // a Chebyshev step k on the residual
  kSmoothFromZero,  // the same on the right-hand side, correction = 0 before
  kRestrict,        // right-hand side of the next level from the residual
  kProlong,         // correction from the next level's
  kSolve,           // the coarsest level
  kPack,            // right-hand side of the finest level from a vector
  kUnpack,          // a vector from the correction
};

struct PlannedStep {
  CycleStep step;
  int level = 0, k = 0;
};

// Smoothing by `smoothing_steps` before, between and after the visits to the next level: one from the finest
// level, two from every other (W), so that the coarse problem is solved about equally well on every grid.
// Read backwards it is the same cycle, which keeps it symmetric.
std::vector<PlannedStep> plan_cycle(std::size_t levels, std::size_t smoothing_steps);

// Chebyshev iteration (Saad, Iterative Methods, algorithm 12.1) on [lowest, highest]. Step k: d = old d +
// new D^-1 r, z += d.
struct ChebyshevStep {
  double old_direction = 0, new_residual = 0;
};
std::vector<ChebyshevStep> chebyshev_steps(double lowest, double highest, unsigned steps);

// Offsets count numbers. Of the finest level `right` and `correction` are what a cycle takes and gives.
struct LevelLayout {
  int nx = 0, ny = 0;              // nodes
  int pitch = 0, stride = 0;       // from row to row; size of a plane
  int stencil = 0, smoother = 0;   // constants: A and M, 20 planes each; A of the coarsest: dense inverse
  int free = 0;                    // constants: 2 planes, 1 or 0
  int inside = 0;                  // constants: 16 planes of the next level's size
  int around_x = 0, around_y = 0;  // constants: LineTransfer::around
  int at_x = 0, at_y = 0;          // table: LineTransfer::at
  int halved = 0;                  // coarse columns on every second of this level's, the next one too
  int vectors = 0;                 // vectors: right, correction, direction, residual, 2 planes each
  int first() const { return pitch + 1; }  // place of node (0, 0) in a plane
  int span() const { return pitch * ny; }  // places from there to the last node, those between rows too
  int right() const { return vectors; }
  int correction() const { return vectors + 2 * stride; }
  int direction() const { return vectors + 4 * stride; }
  int residual() const { return vectors + 6 * stride; }
};

struct HierarchyLayout {
  std::vector<LevelLayout> levels;
  int header_size = 0;  // of the constants: coefficients of the smoother, around, free
  int constants_size = 0;
  int vectors_size = 0;    // of one right-hand side
  std::vector<int> table;  // the levels' fields, then their `at`
};

// Level l has lines[l] and transfers[l] to the next. width: nodes that a work item takes at once;
// coefficients: numbers that the constants begin with. Throws std::invalid_argument when a size exceeds what
// an int can count.
HierarchyLayout lay_out(const std::vector<NodeLines>& lines, const std::vector<GridTransfer>& transfers,
                        std::size_t width, std::size_t coefficients);

}  // namespace teletact::service
