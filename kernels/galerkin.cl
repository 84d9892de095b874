// Setting up multigrid: coarse operators by the Galerkin product, conversion. Built in
// double where the device has it: near nu = 1/2 a product formed in float can lose definiteness.
#include "stencil.clh"

// Both directions' lines of a transfer, as the kernels take them: `lines` holds LineTransfer::at of x and y,
// then
// ::left of x and y; `weights` ::weight of x and y.

// Weight of fine line `line` on coarse line `coarse` (bilinear interpolation in one direction).
real line_weight(global const int* restrict left, global const real* restrict weight, const int line,
                 const int coarse) {
  const int from = left[line];
  return from == coarse ? 1 - weight[line] : from + 1 == coarse ? weight[line] : 0;
}

// For each coarse cell with a fine node inside: how that node is coupled, through its neighbours'
// interpolation, to the cell's four corners, L^-1 A P with D = L L^T its own block. rows: [corner][cell];
// zero where no node is inside. Items: (I, J) of coarse cells.
kernel void interior_rows(global const real4* restrict fine, global real4* restrict rows,
                          global const int* restrict lines, global const real* restrict weights,
                          global const real2* restrict fine_free, const int fine_nx, const int fine_ny,
                          const int nx, const int ny) {
  global const int *at_x = lines, *at_y = at_x + nx;
  global const real *weight_x = weights, *weight_y = weight_x + fine_nx;
  const int i = get_global_id(0), j = get_global_id(1);
  if (i >= nx - 1 || j >= ny - 1) return;
  const int cells = (nx - 1) * (ny - 1), cell = i + (nx - 1) * j, fine_nodes = fine_nx * fine_ny;
  const int x = at_x[i] + 1, y = at_y[j] + 1, node = x + fine_nx * y;
  const bool inside = at_x[i + 1] > x && at_y[j + 1] > y;
  real4 corner[4] = {(real4)(0), (real4)(0), (real4)(0), (real4)(0)};
  for (int b = 0; inside && b < 9; ++b) {
    real4 block = fine[b * fine_nodes + node];
    if (b == 4) block *= (real4)(fine_free[node], fine_free[node]);
    const real east = b % 3 == 1 ? weight_x[x] : b % 3 / 2, down = b / 3 == 1 ? weight_y[y] : b / 3 / 2;
    corner[0] += (1 - east) * (1 - down) * block;
    corner[1] += east * (1 - down) * block;
    corner[2] += (1 - east) * down * block;
    corner[3] += east * down * block;
  }
  const real4 d = inside ? fine[4 * fine_nodes + node] : (real4)(1, 0, 0, 1);
  const real l = 1 / sqrt(d.x), below = d.z * l, last = 1 / sqrt(d.w - below * below);
  for (int p = 0; p < 4; ++p) {
    const real2 first = l * corner[p].xy;
    rows[p * cells + cell] = (real4)(first, last * (corner[p].zw - below * first));
  }
}

// What interior nodes take from the coupling of coarse nodes (i, j) and (to_i, to_j): the sum over the cells
// that hold both of rows^T rows.
real4 interior_part(global const real4* restrict rows, const int i, const int j, const int to_i,
                    const int to_j, const int nx, const int ny) {
  const int cells = (nx - 1) * (ny - 1);
  real4 sum = (real4)(0);
  for (int y = max(max(j, to_j) - 1, 0); y <= min(min(j, to_j), ny - 2); ++y)
    for (int x = max(max(i, to_i) - 1, 0); x <= min(min(i, to_i), nx - 2); ++x) {
      const int cell = x + (nx - 1) * y;
      const real4 a = rows[(i - x + 2 * (j - y)) * cells + cell];
      const real4 b = rows[(to_i - x + 2 * (to_j - y)) * cells + cell];
      sum += (real4)(a.x * b.xy + a.z * b.zw, a.y * b.xy + a.w * b.zw);
    }
  return sum;
}

// Coarse stencil = P^T A P with P the interpolation between unconstrained unknowns (fine_free, coarse_free: 1
// or 0 per unknown), bilinear on the coarse lines and such that the node inside a coarse cell is in
// equilibrium; constrained coarse unknowns get the identity. Items: (coarse i, coarse j, block k - 4); each
// sums over up to 49 blocks. NVIDIA's compiler (580.159) must not unroll these loops: it then adds up others.
kernel void galerkin_product(global const real4* restrict fine, global const real4* restrict rows,
                             global real4* restrict coarse, global const int* restrict lines,
                             global const real* restrict weights, global const real2* restrict fine_free,
                             global const real2* restrict coarse_free, const int fine_nx, const int fine_ny,
                             const int nx, const int ny) {
  global const int *at_x = lines, *at_y = at_x + nx, *left_x = at_y + ny, *left_y = left_x + fine_nx;
  global const real *weight_x = weights, *weight_y = weight_x + fine_nx;
  const int i = get_global_id(0), j = get_global_id(1), k = get_global_id(2) + 4;
  if (i >= nx || j >= ny) return;
  const int to_i = i + k % 3 - 1, to_j = j + k / 3 - 1;
  const int node = i + nx * j, nodes = nx * ny, fine_nodes = fine_nx * fine_ny;
  real4 sum = (real4)(0);
  if (to_i >= 0 && to_i < nx && to_j < ny) {
    const int first_x = max(at_x[to_i] - 1, 0), last_x = min(at_x[to_i] + 1, fine_nx - 1);
    const int first_y = max(at_y[to_j] - 1, 0), last_y = min(at_y[to_j] + 1, fine_ny - 1);
#pragma unroll 1
    for (int y = max(at_y[j] - 1, 0); y <= min(at_y[j] + 1, fine_ny - 1); ++y)
#pragma unroll 1
      for (int x = max(at_x[i] - 1, 0); x <= min(at_x[i] + 1, fine_nx - 1); ++x) {
        const real row = line_weight(left_x, weight_x, x, i) * line_weight(left_y, weight_y, y, j);
        const real2 row_free = row * fine_free[x + fine_nx * y];
#pragma unroll 1
        for (int to_y = max(y - 1, first_y); to_y <= min(y + 1, last_y); ++to_y) {
          const real down = line_weight(left_y, weight_y, to_y, to_j);
#pragma unroll 1
          for (int to_x = max(x - 1, first_x); to_x <= min(x + 1, last_x); ++to_x) {
            const int b = 3 * (to_y - y + 1) + to_x - x + 1;
            const real2 free =
                down * line_weight(left_x, weight_x, to_x, to_i) * fine_free[to_x + fine_nx * to_y];
            sum += (real4)(row_free.x * free, row_free.y * free) * fine[b * fine_nodes + x + fine_nx * y];
          }
        }
      }
    sum -= interior_part(rows, i, j, to_i, to_j, nx, ny);
    const real2 row_free = coarse_free[node], free = coarse_free[to_i + nx * to_j];
    sum *= (real4)(row_free.x * free, row_free.y * free);
    if (k == 4) sum += (real4)(1 - row_free.x, 0, 0, 1 - row_free.y);
  }
  coarse[k * nodes + node] = sum;
  mirror_block(coarse, sum, i, j, k, nx, ny);
}

kernel void to_float(global const real* restrict from, global float* restrict to, const int count) {
  const int n = get_global_id(0);
  if (n < count) to[n] = (float)from[n];
}
