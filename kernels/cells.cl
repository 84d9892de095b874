// Setting up multigrid's smoother: the operator restricted to the 2 x 2 nodes of each cell of the grid,
// inverted, and the sum of these inverses as a stencil. Built in double where the device has it, as
// galerkin.cl.
#include "stencil.clh"

#define UNKNOWNS 8  // of a cell: node p = a + 2 b at (i + a, j + b), two each

// Inverse of the operator on each cell's four nodes, by the sweep operator (Goodnight 1979). inverse:
// [8 x 8][cell]. `indefinite` is set to 1 where a cell is not positive definite. Items: (i, j) of cells.
// Reads 64 and writes 64 reals, about 1000 flops.
kernel void invert_cells(global const real4* restrict a, global real* restrict inverse,
                         global int* restrict indefinite, const int nx, const int ny) {
  const int i = get_global_id(0), j = get_global_id(1);
  if (i >= nx - 1 || j >= ny - 1) return;
  const int nodes = nx * ny, cells = (nx - 1) * (ny - 1), cell = i + (nx - 1) * j;
  real m[UNKNOWNS][UNKNOWNS];
  for (int p = 0; p < 4; ++p)
    for (int q = 0; q < 4; ++q) {
      const int k = 3 * (q / 2 - p / 2 + 1) + q % 2 - p % 2 + 1;
      const real4 block = a[k * nodes + i + p % 2 + nx * (j + p / 2)];
      m[2 * p][2 * q] = block.x;
      m[2 * p][2 * q + 1] = block.y;
      m[2 * p + 1][2 * q] = block.z;
      m[2 * p + 1][2 * q + 1] = block.w;
    }
  for (int k = 0; k < UNKNOWNS; ++k) {
    if (!(m[k][k] > 0)) *indefinite = 1;
    const real pivot = 1 / m[k][k];
    for (int row = 0; row < UNKNOWNS; ++row) {
      const real factor = m[row][k] * pivot;
      for (int column = 0; column < UNKNOWNS; ++column)
        m[row][column] -= row == k || column == k ? 0 : factor * m[k][column];
    }
    for (int n = 0; n < UNKNOWNS; ++n) {
      m[n][k] *= n == k ? 1 : pivot;
      m[k][n] *= n == k ? 1 : pivot;
    }
    m[k][k] = -pivot;
  }
  for (int row = 0; row < UNKNOWNS; ++row)
    for (int column = 0; column < UNKNOWNS; ++column)
      inverse[(UNKNOWNS * row + column) * cells + cell] = -m[row][column];
}

// Stencil of the sum of these inverses. Items: (i, j, block k); each sums over up to 4 cells.
kernel void gather_cells(global const real* restrict inverse, global real4* restrict stencil, const int nx,
                         const int ny) {
  const int i = get_global_id(0), j = get_global_id(1), k = get_global_id(2);
  if (i >= nx || j >= ny) return;
  const int to_i = i + k % 3 - 1, to_j = j + k / 3 - 1, cells = (nx - 1) * (ny - 1);
  real4 sum = (real4)(0);
  // Cells (x, y) that hold both nodes.
  for (int y = max(max(j, to_j) - 1, 0); y <= min(min(j, to_j), ny - 2); ++y)
    for (int x = max(max(i, to_i) - 1, 0); x <= min(min(i, to_i), nx - 2); ++x) {
      const int row = 2 * (i - x + 2 * (j - y)), column = 2 * (to_i - x + 2 * (to_j - y));
      global const real* from = inverse + (UNKNOWNS * row + column) * cells + x + (nx - 1) * y;
      sum += (real4)(from[0], from[cells], from[UNKNOWNS * cells], from[(UNKNOWNS + 1) * cells]);
    }
  stencil[k * nx * ny + i + nx * j] = sum;
}
