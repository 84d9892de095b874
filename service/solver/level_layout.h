// Where multigrid's levels lie in its arrays on the device (kernels/levels.clh): a plane holds one number for
// each node of a level, with a column of zeros between rows and a margin of zeros around.
#pragma once

#include <cstddef>
#include <vector>

#include "service/solver/node_lines.h"

namespace teletact::service {

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
