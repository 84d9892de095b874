// Setting up multigrid's smoother: the operator restricted to the 2 x 2 nodes of each cell of the grid,
// inverted, and the sum of these inverses as a stencil. Built in double where the device has it, as
// galerkin.cl.
#include "levels.clh"
#include "planes.clh"

#define UNKNOWNS 8  // of a cell: node p = a + 2 b at (i + a, j + b), two each
#define ENTRIES 36  // of a symmetric matrix of these, its lower triangle by rows
#define ENTRY(r, c) ((r) >= (c) ? (r) * ((r) + 1) / 2 + (c) : (c) * ((c) + 1) / 2 + (r))

// Of the array of inverses: cells of a row are padded to whole work items.
int cells_of_row(const int nx) {
  return (nx - 1 + WIDTH - 1) / WIDTH * WIDTH;
}

// Inverse of the operator (stencil.clh) on each cell's four nodes, by the sweep operator (Goodnight 1979),
// WIDTH cells at once. inverse: [ENTRIES][row][cell]. `indefinite` is set to 1 where a cell is not positive
// definite. Items: (i / WIDTH, j) of cells. Loops are unrolled so that the block lives in registers. Reads 36
// and writes 36 reals, about 500 flops per cell.
kernel void invert_cells(global const real* restrict a, global real* restrict inverse,
                         global int* restrict indefinite, const int nx, const int ny) {
  const int i = WIDTH * get_global_id(0), j = get_global_id(1);
  if (i >= nx - 1 || j >= ny - 1) return;
  const int nodes = nx * ny, row = cells_of_row(nx);
  real entries[ENTRIES * WIDTH], pivots[UNKNOWNS * WIDTH];
#pragma unroll
  for (int p = 0; p < 4; ++p)
#pragma unroll
    for (int q = 0; q <= p; ++q) {
      const int k = 3 * (q / 2 - p / 2 + 1) + q % 2 - p % 2 + 1;
      global const real* block = a + 4 * (k * nodes + p % 2 + nx * (j + p / 2));
      for (int lane = 0; lane < WIDTH; ++lane) {
        const int at = 4 * min(i + lane, nx - 2);  // beyond the row: the last cell again
        entries[WIDTH * ENTRY(2 * p, 2 * q) + lane] = block[at];
        if (q < p) entries[WIDTH * ENTRY(2 * p, 2 * q + 1) + lane] = block[at + 1];
        entries[WIDTH * ENTRY(2 * p + 1, 2 * q) + lane] = block[at + 2];
        entries[WIDTH * ENTRY(2 * p + 1, 2 * q + 1) + lane] = block[at + 3];
      }
    }
  vec m[ENTRIES];
#pragma unroll
  for (int n = 0; n < ENTRIES; ++n) m[n] = LOAD(entries + WIDTH * n);
#pragma unroll
  for (int k = 0; k < UNKNOWNS; ++k) {
    vec column[UNKNOWNS];
#pragma unroll
    for (int n = 0; n < UNKNOWNS; ++n) column[n] = m[ENTRY(n, k)];
    STORE(column[k], pivots + WIDTH * k);
    const vec pivot = 1 / column[k];
#pragma unroll
    for (int r = 0; r < UNKNOWNS; ++r) {
      const vec factor = pivot * column[r];
#pragma unroll
      for (int c = 0; c <= r; ++c)
        m[ENTRY(r, c)] = r == k && c == k   ? -pivot
                         : r == k || c == k ? pivot * column[r == k ? c : r]
                                            : m[ENTRY(r, c)] - factor * column[c];
    }
  }
  bool definite = true;
  for (int n = 0; n < UNKNOWNS * WIDTH; ++n) definite = definite && pivots[n] > 0;
  if (!definite) *indefinite = 1;
#pragma unroll
  for (int n = 0; n < ENTRIES; ++n) STORE(-m[n], inverse + (n * (ny - 1) + j) * row + i);
}

// The sum of these inverses as a stencil of multigrid (levels.clh), 20 planes from `at` on. Items: places;
// each reads 4 x 16 reals.
kernel void gather_cells(global const real* restrict inverse, global WORK* restrict planes, const int at,
                         const int stride, const int nx, const int ny) {
  const int n = get_global_id(0);
  if (n >= stride) return;
  const int node = node_at(n, nx, ny), i = node % nx, j = node / nx;
  const int row = cells_of_row(nx), cells = row * (ny - 1);
  real4 sum[9];
#pragma unroll
  for (int k = 0; k < 9; ++k) sum[k] = (real4)(0);
    // The four cells that hold the node, as their node p, and their nodes q.
#pragma unroll
  for (int p = 0; p < 4; ++p) {
    const int x = i - p % 2, y = j - p / 2;
    if (node < 0 || x < 0 || y < 0 || x > nx - 2 || y > ny - 2) continue;
    global const real* from = inverse + x + row * y;
#pragma unroll
    for (int q = 0; q < 4; ++q)
      sum[3 * (q / 2 - p / 2 + 1) + q % 2 - p % 2 + 1] +=
          (real4)(from[ENTRY(2 * p, 2 * q) * cells], from[ENTRY(2 * p, 2 * q + 1) * cells],
                  from[ENTRY(2 * p + 1, 2 * q) * cells], from[ENTRY(2 * p + 1, 2 * q + 1) * cells]);
  }
  real4 all = sum[4];
#pragma unroll
  for (int k = 0; k < 4; ++k) {
    all += sum[k] + sum[5 + k];
    store_block(sum[5 + k], planes + at + 4 * (k + 1) * stride + n, stride);
  }
  store_block(all, planes + at + n, stride);
}
