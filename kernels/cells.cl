// Setting up multigrid's smoother: the operator restricted to the 2 x 2 nodes of each cell of the grid,
// inverted, and the sum of these inverses as a stencil. Built in double where the device has it, as
// galerkin.cl.
#include "stencil.clh"

#define UNKNOWNS 8  // of a cell: node p = a + 2 b at (i + a, j + b), two each

// Inverse of the operator on each cell's four nodes, by the sweep operator (Goodnight 1979). inverse:
// [cell][8 x 8]. `indefinite` is set to 1 where a cell is not positive definite. Items: (i, j) of cells. Loops
// are unrolled so that the block lives in registers: 2 to 3 times as fast.
// Reads 64 and writes 64 reals, about 1000 flops.
kernel void invert_cells(global const real4* restrict a, global real* restrict inverse,
                         global int* restrict indefinite, const int nx, const int ny) {
  const int i = get_global_id(0), j = get_global_id(1);
  if (i >= nx - 1 || j >= ny - 1) return;
  const int nodes = nx * ny, cell = i + (nx - 1) * j;
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
#pragma unroll
  for (int k = 0; k < UNKNOWNS; ++k) {
    if (!(m[k][k] > 0)) *indefinite = 1;
    const real pivot = 1 / m[k][k];
#pragma unroll
    for (int row = 0; row < UNKNOWNS; ++row) {
      const real factor = m[row][k] * pivot;
#pragma unroll
      for (int column = 0; column < UNKNOWNS; ++column)
        m[row][column] -= row == k || column == k ? 0 : factor * m[k][column];
    }
#pragma unroll
    for (int n = 0; n < UNKNOWNS; ++n) {
      m[n][k] *= n == k ? 1 : pivot;
      m[k][n] *= n == k ? 1 : pivot;
    }
    m[k][k] = -pivot;
  }
  for (int row = 0; row < UNKNOWNS; ++row)
    for (int column = 0; column < UNKNOWNS; ++column)
      inverse[UNKNOWNS * (UNKNOWNS * cell + row) + column] = -m[row][column];
}

// Stencil of the sum of these inverses. Items: (i, j); each reads 4 x 16 of the reals of up to 4 cells.
kernel void gather_cells(global const real* restrict inverse, global real4* restrict stencil, const int nx,
                         const int ny) {
  const int i = get_global_id(0), j = get_global_id(1);
  if (i >= nx || j >= ny) return;
  real4 sum[9];
#pragma unroll
  for (int k = 0; k < 9; ++k) sum[k] = (real4)(0);
    // The four cells that hold the node, as their node p, and their nodes q.
#pragma unroll
  for (int p = 0; p < 4; ++p) {
    const int x = i - p % 2, y = j - p / 2;
    if (x < 0 || y < 0 || x > nx - 2 || y > ny - 2) continue;
    global const real* row = inverse + UNKNOWNS * (UNKNOWNS * (x + (nx - 1) * y) + 2 * p);
#pragma unroll
    for (int q = 0; q < 4; ++q)
      sum[3 * (q / 2 - p / 2 + 1) + q % 2 - p % 2 + 1] +=
          (real4)(row[2 * q], row[2 * q + 1], row[UNKNOWNS + 2 * q], row[UNKNOWNS + 2 * q + 1]);
  }
#pragma unroll
  for (int k = 0; k < 9; ++k) stencil[k * nx * ny + i + nx * j] = sum[k];
}
