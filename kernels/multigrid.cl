// Geometric multigrid for 9-point stencils of 2x2 blocks: smoothing, transfers, residual. Work items: (i, j,
// right-hand side) unless said otherwise; global sizes may be rounded up. A product with the stencil reads 36
// reals of it and 18 of the vector per node and takes 72 flops.
#include "stencil.clh"

// y = A x
kernel void stencil_apply(global const real4* restrict a, global const real2* restrict x,
                          global real2* restrict y, const int nx, const int ny) {
  const int i = get_global_id(0), j = get_global_id(1), nodes = nx * ny, base = get_global_id(2) * nodes;
  if (i >= nx || j >= ny) return;
  y[base + i + nx * j] = stencil_times(a, x + base, i, j, nx, ny);
}

// residual = r - A z
kernel void stencil_residual(global const real4* restrict a, global const real2* restrict r,
                             global const real2* restrict z, global real2* restrict residual, const int nx,
                             const int ny) {
  const int i = get_global_id(0), j = get_global_id(1), nodes = nx * ny, base = get_global_id(2) * nodes;
  if (i >= nx || j >= ny) return;
  const int at = base + i + nx * j;
  residual[at] = r[at] - stencil_times(a, z + base, i, j, nx, ny);
}

// Chebyshev step: d = c_old d + c_new M residual, z += d; from_zero: z = d. M: the stencil of cells.cl.
kernel void cell_step(global const real4* restrict m, global const real2* restrict residual,
                      global real2* restrict d, global real2* restrict z, const real c_old, const real c_new,
                      const int from_zero, const int nx, const int ny) {
  const int i = get_global_id(0), j = get_global_id(1), nodes = nx * ny, base = get_global_id(2) * nodes;
  if (i >= nx || j >= ny) return;
  const int at = base + i + nx * j;
  const real2 old = c_old == 0 ? (real2)(0) : c_old * d[at];  // a first step finds rubbish in d
  const real2 step = old + c_new * stencil_times(m, residual + base, i, j, nx, ny);
  d[at] = step;
  z[at] = from_zero ? step : z[at] + step;
}

// Solves for the node inside each coarse cell, all others held: z += D^-1 (r - A z) there. No two of them
// couple. inverse: D^-1, D the nodes' own blocks. Items: (I, J, right-hand side) of coarse cells; nx, ny are
// the fine level's, coarse_nx, coarse_ny the coarse level's nodes.
kernel void relax_interior(global const real4* restrict a, global const real4* restrict inverse,
                           global const real2* restrict r, global real2* restrict z,
                           global const int* restrict at_x, global const int* restrict at_y, const int nx,
                           const int ny, const int coarse_nx, const int coarse_ny) {
  const int i = get_global_id(0), j = get_global_id(1), nodes = nx * ny, base = get_global_id(2) * nodes;
  if (i >= coarse_nx - 1 || j >= coarse_ny - 1) return;
  const int x = at_x[i] + 1, y = at_y[j] + 1, node = x + nx * y;
  if (at_x[i + 1] == x || at_y[j + 1] == y) return;  // no line was dropped here
  const real2 residual = r[base + node] - stencil_times(a, z + base, x, y, nx, ny);
  z[base + node] += block_times(inverse[node], residual);
}

// Coarse = P^T fine, over coarse nodes. Coarse line I lies on fine line at[I]; the fine lines just before and
// after it, where they are not coarse themselves, belong to it with weights around[I] = (before, after).
kernel void restrict_residual(global const real2* restrict fine, global real2* restrict coarse,
                              global const int* restrict at_x, global const real2* restrict around_x,
                              global const int* restrict at_y, global const real2* restrict around_y,
                              global const real2* restrict coarse_free, const int fine_nx, const int fine_ny,
                              const int nx, const int ny) {
  const int i = get_global_id(0), j = get_global_id(1), q = get_global_id(2);
  if (i >= nx || j >= ny) return;
  const real2 wx = around_x[i], wy = around_y[j];
  const int x = at_x[i], y = at_y[j];
  const int west = x > 0 ? -1 : 0, east = x + 1 < fine_nx ? 1 : 0;
  const int up = y > 0 ? -fine_nx : 0, down = y + 1 < fine_ny ? fine_nx : 0;
  global const real2* f = fine + q * fine_nx * fine_ny + x + fine_nx * y;
  const real2 above = wx.x * f[up + west] + f[up] + wx.y * f[up + east];
  const real2 level = wx.x * f[west] + f[0] + wx.y * f[east];
  const real2 below = wx.x * f[down + west] + f[down] + wx.y * f[down + east];
  const int node = i + nx * j;
  coarse[q * nx * ny + node] = coarse_free[node] * (wy.x * above + level + wy.y * below);
}

// fine += P coarse, over fine nodes, bilinear by coordinates: fine line i lies between coarse lines left[i]
// and left[i] + 1, with weight weight[i] on the latter.
kernel void prolong_add(global const real2* restrict coarse, global real2* restrict fine,
                        global const int* restrict left_x, global const real* restrict weight_x,
                        global const int* restrict left_y, global const real* restrict weight_y,
                        global const real2* restrict fine_free, const int nx, const int ny,
                        const int coarse_nx, const int coarse_ny) {
  const int i = get_global_id(0), j = get_global_id(1), q = get_global_id(2);
  if (i >= nx || j >= ny) return;
  const int x = left_x[i], y = left_y[j];
  const int east = x + 1 < coarse_nx ? 1 : 0, down = y + 1 < coarse_ny ? coarse_nx : 0;
  const real tx = weight_x[i], ty = weight_y[j];
  global const real2* c = coarse + q * coarse_nx * coarse_ny + x + coarse_nx * y;
  const real2 above = (1 - tx) * c[0] + tx * c[east], below = (1 - tx) * c[down] + tx * c[down + east];
  const int node = i + nx * j;
  fine[q * nx * ny + node] += fine_free[node] * ((1 - ty) * above + ty * below);
}

// The coarsest level: z = inverse r with the dense inverse of all its unknowns. Items: (unknown, right-hand
// side), each a row of it; four partial sums, so that the row is read in vectors.
kernel void dense_apply(global const real* restrict inverse, global const real* restrict r,
                        global real* restrict z, const int unknowns) {
  const int n = get_global_id(0), base = get_global_id(1) * unknowns;
  if (n >= unknowns) return;
  global const real* row = inverse + n * unknowns;
  real4 sums = (real4)(0);
  for (int m = 0; m < unknowns / 4; ++m) sums += vload4(m, row) * vload4(m, r + base);
  real sum = (sums.x + sums.y) + (sums.z + sums.w);
  for (int m = unknowns / 4 * 4; m < unknowns; ++m) sum += row[m] * r[base + m];
  z[base + n] = sum;
}
