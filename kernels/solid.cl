// Solid elasticity on hexahedra (T8) and conjugate gradients for a touched block: service/tissue/solid/solid_solver.h.
//
// Fields: [plane = 3 row + component][z][x]. Those that K is applied to are *wide*: each row of x has WIDTH
// numbers before and after it, the other end's, and there is one more row of nodes, the held one, of zeros.
// Items over a field: (group of WIDTH nodes, k, plane or row).
#include "wide.clh"

// Scalars, as in service/tissue/solid/solid_solver.cpp.
#define RHO 0    // r . z
#define ALPHA 1  // of this step
#define BETA 2   // of the next direction
#define CURVATURE 3

real sum_lanes(const vec v) {
#if WIDTH == 1
  return v;
#else
  real lanes[WIDTH], sum = 0;
  STORE(v, lanes);
  for (int lane = 0; lane < WIDTH; ++lane) sum += lanes[lane];
  return sum;
#endif
}

// out = K d, and partial sums of d . K d, one of each item. stiffness: of each layer 24 x 24 for a modulus of
// 1 (service/tissue/solid/solid_tissue.h); modulus: [layer][z][x], wide in x. 1152 flops a node.
kernel void solid_apply(global const real* restrict stiffness, global const real* restrict modulus,
                        global const real* restrict d, global real* restrict out,
                        global accum* restrict partial, const int nx, const int nz, const int layers) {
  const int group = get_global_id(0), k = get_global_id(1), j = get_global_id(2);
  if (group * WIDTH >= nx || k >= nz || j >= layers) return;
  const int wide = nx + 2 * WIDTH, i = WIDTH * (group + 1);
  vec force[3];
  for (int p = 0; p < 3; ++p) force[p] = (vec)(0);
  for (int ey = j == 0 ? 1 : 0; ey < 2; ++ey) {
    const int layer = j - 1 + ey;
    for (int ez = 0; ez < 2; ++ez) {
      const int z0 = ez ? k : (k + nz - 1) % nz, z1 = z0 + 1 == nz ? 0 : z0 + 1;
#pragma unroll
      for (int ex = 0; ex < 2; ++ex) {
        const int x = i - 1 + ex;
        global const real* row = stiffness + 576 * layer + 72 * ((1 - ex) + 2 * (1 - ez) + 4 * (1 - ey));
        vec f[3];
        for (int p = 0; p < 3; ++p) f[p] = (vec)(0);
#pragma unroll
        for (int b = 0; b < 8; ++b) {
          const int plane = 3 * (layer + (b >> 2)), z = (b >> 1) & 1 ? z1 : z0;
#pragma unroll
          for (int c = 0; c < 3; ++c) {
            const vec u = LOAD(d + ((plane + c) * nz + z) * wide + x + (b & 1));
            f[0] += row[3 * b + c] * u;
            f[1] += row[24 + 3 * b + c] * u;
            f[2] += row[48 + 3 * b + c] * u;
          }
        }
        const vec e = LOAD(modulus + (layer * nz + z0) * wide + x);
        for (int p = 0; p < 3; ++p) force[p] += e * f[p];
      }
    }
  }
  vec dot = (vec)(0);
  for (int p = 0; p < 3; ++p) {
    const int row = (3 * j + p) * nz + k;
    dot += force[p] * LOAD(d + row * wide + i);
    STORE(force[p], out + row * nx + WIDTH * group);
  }
  partial[(j * nz + k) * (nx / WIDTH) + group] = sum_lanes(dot);
}

// d = z + beta d, wide; beta = 0 at the start, where d holds nothing.
kernel void solid_direction(global const real* restrict scalars, global const real* restrict z,
                            global real* restrict d, const int nx, const int nz, const int planes) {
  const int group = get_global_id(0), k = get_global_id(1), plane = get_global_id(2);
  if (group * WIDTH >= nx || k >= nz || plane >= planes) return;
  const int row = plane * nz + k, groups = nx / WIDTH;
  const real beta = scalars[BETA];
  global real* to = d + row * (nx + 2 * WIDTH) + WIDTH * (group + 1);
  vec v = LOAD(z + row * nx + WIDTH * group);
  if (beta != 0) v += beta * LOAD(to);
  STORE(v, to);
  if (group == 0) STORE(v, to + nx);
  if (group == groups - 1) STORE(v, to - nx);
}

// Partial sums of a . b: each item sums `chunk` groups of WIDTH. Items: (chunk), as in solid_step.
kernel void solid_dot(global const real* restrict a, global const real* restrict b,
                      global accum* restrict partial, const int groups, const int chunk) {
  const int n = get_global_id(0), begin = n * chunk, end = min(begin + chunk, groups);
  if (begin >= groups) return;
  vec sum = (vec)(0);
  for (int m = begin; m < end; ++m) sum += LOAD(a + WIDTH * m) * LOAD(b + WIDTH * m);
  partial[n] = sum_lanes(sum);
}

// u += alpha d, r -= alpha K d.
kernel void solid_step(global const real* restrict scalars, global const real* restrict d,
                       global const real* restrict kd, global real* restrict u, global real* restrict r,
                       const int nx, const int nz, const int planes) {
  const int group = get_global_id(0), k = get_global_id(1), plane = get_global_id(2);
  if (group * WIDTH >= nx || k >= nz || plane >= planes) return;
  const int row = plane * nz + k, at = row * nx + WIDTH * group;
  const real alpha = scalars[ALPHA];
  STORE(LOAD(u + at) + alpha * LOAD(d + row * (nx + 2 * WIDTH) + WIDTH * (group + 1)), u + at);
  STORE(LOAD(r + at) - alpha * LOAD(kd + at), r + at);
}

// out = a - b on a field.
kernel void solid_subtract(global const real* restrict a, global const real* restrict b,
                           global real* restrict out, const int groups) {
  const int n = get_global_id(0);
  if (n < groups) STORE(LOAD(a + WIDTH * n) - LOAD(b + WIDTH * n), out + WIDTH * n);
}

// Eight sums at once: one after the other would wait for each addition.
accum sum_of(global const accum* restrict partial, const int count) {
  accum sums[8] = {0, 0, 0, 0, 0, 0, 0, 0};
  int n = 0;
  for (; n + 8 <= count; n += 8)
    for (int s = 0; s < 8; ++s) sums[s] += partial[n + s];
  for (; n < count; ++n) sums[0] += partial[n];
  return ((sums[0] + sums[1]) + (sums[2] + sums[3])) + ((sums[4] + sums[5]) + (sums[6] + sums[7]));
}

// The patch: `freedoms` says where in a field its unknowns are, all in the planes of one row of nodes; those whose
// skins bear q give way by C q. M = (S0 + C)^-1, dense.

// q = M B z0, z0 how the tissue would move by itself. Items: rows of M.
kernel void patch_project(global const real* restrict inverse, global const int* restrict freedoms,
                          global const real* restrict surface, global real* restrict q, const int count) {
  const int row = get_global_id(0);
  if (row >= count) return;
  real sum = 0;
  for (int n = 0; n < count; ++n) sum += inverse[row * count + n] * surface[freedoms[n]];
  q[row] = sum;
}

// field = sign B^T q, in unknowns begin ... end - 1 of a row of nodes that begins at `row` in the field. slots:
// of each unknown of the row, its number in the patch or -1.
kernel void patch_spread(global const int* restrict slots, global const real* restrict q,
                         global real* restrict field, const real sign, const int begin, const int end,
                         const int row) {
  const int n = begin + get_global_id(0);
  if (n < end) field[row + n] = slots[n] >= 0 ? sign * q[slots[n]] : 0;
}

// beta from r . z, and the patch's direction dq = q + beta dq. One item, here and below.
kernel void patch_turn(global const accum* restrict partial, global real* restrict scalars,
                       global const real* restrict q, global real* restrict dq, const int partials,
                       const int count, const int start) {
  if (get_global_id(0) != 0) return;
  const real rho = sum_of(partial, partials), beta = start ? 0 : rho / scalars[RHO];
  scalars[RHO] = rho;
  scalars[BETA] = beta;
  for (int n = 0; n < count; ++n) dq[n] = start ? q[n] : q[n] + beta * dq[n];
}

// alpha = r . z / d . (K d + B^T dq), and that product completed: kd += B^T dq, p -= alpha dq.
kernel void patch_step(global const accum* restrict partial, global real* restrict scalars,
                       global const int* restrict freedoms, global const real* restrict d,
                       global real* restrict kd, global real* restrict p, global const real* restrict dq,
                       const int partials, const int count, const int nx) {
  if (get_global_id(0) != 0) return;
  real curvature = sum_of(partial, partials);
  for (int n = 0; n < count; ++n) {
    const int at = freedoms[n];
    curvature += dq[n] * d[(at / nx) * (nx + 2 * WIDTH) + WIDTH + at % nx];
    kd[at] += dq[n];
  }
  const real alpha = curvature > 0 ? scalars[RHO] / curvature : 0;
  scalars[ALPHA] = alpha;
  scalars[CURVATURE] = curvature;
  for (int n = 0; n < count; ++n) p[n] -= alpha * dq[n];
}
