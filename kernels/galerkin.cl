// Setting up multigrid: coarse operators by the Galerkin product, diagonal blocks, conversion. Built in
// double where the device has it: near nu = 1/2 a product formed in float can lose definiteness.
#include "stencil.clh"

// Weight of fine line `line` on coarse line `coarse` (bilinear interpolation in one direction).
real line_weight(global const int* restrict left, global const real* restrict weight, const int line,
                 const int coarse) {
  const int from = left[line];
  return from == coarse ? 1 - weight[line] : from + 1 == coarse ? weight[line] : 0;
}

// Coarse stencil = P^T A P with P the interpolation between unconstrained unknowns (fine_free, coarse_free: 1
// or 0 per unknown); constrained coarse unknowns get the identity. Items: (coarse i, coarse j, block k); each
// sums over 9 fine nodes and their 9 neighbours, up to 81 blocks.
kernel void galerkin_product(global const real4* restrict fine, global real4* restrict coarse,
                             global const int* restrict at_x, global const int* restrict at_y,
                             global const int* restrict left_x, global const real* restrict weight_x,
                             global const int* restrict left_y, global const real* restrict weight_y,
                             global const real2* restrict fine_free, global const real2* restrict coarse_free,
                             const int fine_nx, const int fine_ny, const int nx, const int ny) {
  const int i = get_global_id(0), j = get_global_id(1), k = get_global_id(2);
  if (i >= nx || j >= ny) return;
  const int to_i = i + k % 3 - 1, to_j = j + k / 3 - 1;
  const int node = i + nx * j, nodes = nx * ny, fine_nodes = fine_nx * fine_ny;
  real4 sum = (real4)(0);
  if (to_i >= 0 && to_i < nx && to_j >= 0 && to_j < ny) {
    for (int y = max(at_y[j] - 1, 0); y <= min(at_y[j] + 1, fine_ny - 1); ++y)
      for (int x = max(at_x[i] - 1, 0); x <= min(at_x[i] + 1, fine_nx - 1); ++x) {
        const real row = line_weight(left_x, weight_x, x, i) * line_weight(left_y, weight_y, y, j);
        const real2 row_free = fine_free[x + fine_nx * y];
        for (int b = 0; b < 9; ++b) {
          const int to_x = x + b % 3 - 1, to_y = y + b / 3 - 1;
          if (to_x < 0 || to_x >= fine_nx || to_y < 0 || to_y >= fine_ny) continue;
          const real column =
              line_weight(left_x, weight_x, to_x, to_i) * line_weight(left_y, weight_y, to_y, to_j);
          const real2 free = fine_free[to_x + fine_nx * to_y];
          const real4 mask =
              (real4)(row_free.x * free.x, row_free.x * free.y, row_free.y * free.x, row_free.y * free.y);
          sum += row * column * mask * fine[b * fine_nodes + x + fine_nx * y];
        }
      }
    const real2 row_free = coarse_free[node], free = coarse_free[to_i + nx * to_j];
    sum *= (real4)(row_free.x * free.x, row_free.x * free.y, row_free.y * free.x, row_free.y * free.y);
    if (k == 4) sum += (real4)(1 - row_free.x, 0, 0, 1 - row_free.y);
  }
  coarse[k * nodes + node] = sum;
}

// Inverse of each node's own block; zero for a block that is not positive definite.
kernel void invert_diagonal(global const real4* restrict a, global real4* restrict inverse, const int nodes) {
  const int node = get_global_id(0);
  if (node >= nodes) return;
  const real4 d = a[4 * nodes + node];
  const real determinant = d.x * d.w - d.y * d.z;
  const real4 adjugate = (real4)(d.w, -d.y, -d.z, d.x);
  inverse[node] = d.x > 0 && determinant > 0 ? adjugate / determinant : (real4)(0);
}

kernel void to_float(global const real* restrict from, global float* restrict to, const int count) {
  const int n = get_global_id(0);
  if (n < count) to[n] = (float)from[n];
}
