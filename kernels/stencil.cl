#include "stencil.clh"

// y = A x for a stencil. Items: (i, j, right-hand side). Reads 36 reals of it and 18 of the vector per node,
// 72 flops.
kernel void stencil_apply(global const real4* restrict a, global const real2* restrict x,
                          global real2* restrict y, const int nx, const int ny) {
  const int i = get_global_id(0), j = get_global_id(1), nodes = nx * ny, base = get_global_id(2) * nodes;
  if (i >= nx || j >= ny) return;
  y[base + i + nx * j] = stencil_times(a, x + base, i, j, nx, ny);
}
