// Into multigrid's planes (levels.clh). Items run over whole planes, so that what does not exist becomes
// zero.
#include "planes.clh"

// The 20 planes of a symmetric stencil (stencil.clh), from `at` on.
kernel void stencil_to_planes(global const real4* restrict stencil, global WORK* restrict planes,
                              const int at, const int stride, const int nx, const int ny) {
  const int n = get_global_id(0);
  if (n >= stride) return;
  const int node = node_at(n, nx, ny), nodes = nx * ny;
  real4 sum = (real4)(0);
  for (int k = 0; k < 9; ++k) {
    const real4 block = node < 0 ? (real4)(0) : stencil[k * nodes + node];
    sum += block;
    if (k < 5) continue;
    store_block(block, planes + at + 4 * (k - 4) * stride + n, stride);
  }
  store_block(sum, planes + at + n, stride);
}

// P at the nodes inside coarse cells: the block that takes the displacement of a cell's corner to the node
// inside, in equilibrium: bilinear part less D^-1 A P_bilinear. rows: kernels/galerkin.cl. 16 planes over
// coarse nodes, [corner][block]; zero for cells without a node inside. nx, ny: coarse nodes.
kernel void inside_to_planes(global const real4* restrict fine, global const real4* restrict rows,
                             global const real2* restrict fine_free, global const int* restrict lines,
                             global const real* restrict weights, global WORK* restrict planes, const int at,
                             const int stride, const int fine_nx, const int fine_ny, const int nx,
                             const int ny) {
  global const int *at_x = lines, *at_y = at_x + nx;
  global const real *weight_x = weights, *weight_y = weight_x + fine_nx;
  const int n = get_global_id(0);
  if (n >= stride) return;
  const int coarse = node_at(n, nx, ny), i = coarse % nx, j = coarse / nx;
  const bool cell = coarse >= 0 && i + 1 < nx && j + 1 < ny;
  const int x = cell ? at_x[i] + 1 : 0, y = cell ? at_y[j] + 1 : 0, node = x + fine_nx * y;
  const bool inside = cell && at_x[i + 1] > x && at_y[j + 1] > y;
  const real4 d = inside ? fine[4 * fine_nx * fine_ny + node] : (real4)(1, 0, 0, 1);
  const real l = 1 / sqrt(d.x), below = d.z * l, last = 1 / sqrt(d.w - below * below);
  for (int p = 0; p < 4; ++p) {
    real4 block = (real4)(0);
    if (inside) {
      const real4 row = rows[p * (nx - 1) * (ny - 1) + i + (nx - 1) * j];
      const real2 second = last * row.zw, first = l * (row.xy - below * second);
      const real w = (p % 2 ? weight_x[x] : 1 - weight_x[x]) * (p / 2 ? weight_y[y] : 1 - weight_y[y]);
      block = (real4)(w * fine_free[node].x - first.x, -first.y, -second.x, w * fine_free[node].y - second.y);
    }
    store_block(block, planes + at + 4 * p * stride + n, stride);
  }
}
