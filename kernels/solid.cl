// Solid elasticity on hexahedra (T8) and conjugate gradients for a touched block:
// service/tissue/solid/solid_solver.h. An iteration is, on processors, solid_step, the preconditioner's
// launches with patch_project and patch_spread between them, solid_dot, solid_direction and solid_apply; on
// GPUs those of solid_groups.cl, and solid_advance.
//
// Fields: [plane = 3 row + component][z][x]. On processors those that K is applied to are *wide*: each row of
// x has WIDTH numbers before and after it, the other end's, and there is one more row of nodes, the held one,
// of zeros.
#include "solid_marks.clh"

// The patch: `unknowns` says where in a field it is, all in the three planes of one row of nodes, `slots` of
// each unknown of that row its number in the patch or -1. Those whose skins bear q give way by C q. M = (S0 +
// C)^-1, dense. dq: the patch's part of a direction.

// out = K d + B^T dq and partial sums of d . that, one of each row of x. stiffness: of each layer 24 x 24 for
// a modulus of 1 (service/tissue/solid/solid_tissue.h); modulus: [layer][z][x], wide in x; patch_row: -1
// where no dq is. Items: (k, row of nodes). 1152 flops a node.
kernel void solid_apply(global const real* restrict stiffness, global const real* restrict modulus,
                        global const real* restrict d, global real* restrict out,
                        global accum* restrict partial, global const int* restrict slots,
                        global const real* restrict dq, const int nx, const int nz, const int layers,
                        const int patch_row) {
  const int k = get_global_id(0), j = get_global_id(1);
  if (k >= nz || j >= layers) return;
  const int wide = nx + 2 * WIDTH;
  vec dot = (vec)(0);
  for (int i = WIDTH; i < nx + WIDTH; i += WIDTH) {
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
    for (int p = 0; p < 3; ++p) {
      const int row = (3 * j + p) * nz + k;
      global real* to = out + row * nx + i - WIDTH;
      STORE(force[p], to);
      if (j == patch_row) {
        global const int* slot = slots + (p * nz + k) * nx + i - WIDTH;
        for (int lane = 0; lane < WIDTH; ++lane)
          if (slot[lane] >= 0) to[lane] += dq[slot[lane]];
        force[p] = LOAD(to);
      }
      dot += force[p] * LOAD(d + row * wide + i);
    }
  }
  partial[j * nz + k] = sum_lanes(dot);
}

// d = z + beta d, wide, and dq = q + beta dq; beta = 0 at the start, where they hold nothing. Items: planes.
kernel void solid_direction(global real* restrict marks, global const real* restrict z,
                            global real* restrict d, global const int* restrict slots,
                            global const real* restrict q, global real* restrict dq, const int nx,
                            const int nz, const int planes, const int parts, const int patch_row,
                            const int before, const int turn) {
  const int plane = get_global_id(0);
  if (plane >= planes) return;
  const real beta = direction_factor(marks, parts, before, turn, plane == 0, 0);
  for (int row = plane * nz; row < (plane + 1) * nz; ++row)
    for (int n = 0; n < nx; n += WIDTH) {
      global real* to = d + row * (nx + 2 * WIDTH) + WIDTH + n;
      vec v = LOAD(z + row * nx + n);
      if (beta != 0) v += beta * LOAD(to);
      STORE(v, to);
      if (n == 0) STORE(v, to + nx);
      if (n + WIDTH == nx) STORE(v, to - nx);
    }
  if (patch_row < 0 || plane / 3 != patch_row) return;
  for (int n = plane % 3 * nz * nx; n < (plane % 3 + 1) * nz * nx; ++n)
    if (slots[n] >= 0) dq[slots[n]] = q[slots[n]] + (beta != 0 ? beta * dq[slots[n]] : 0);
}

// u += alpha d, r -= alpha K d. Rows of d begin and end with WIDTH numbers more. Items: planes.
kernel void solid_step(global const real* restrict d, global const real* restrict kd, global real* restrict u,
                       global real* restrict r, global const accum* restrict curvature,
                       global real* restrict marks, const int nx, const int nz, const int planes,
                       const int parts, const int before) {
  const int plane = get_global_id(0);
  if (plane >= planes) return;
  const real alpha = step_length(marks, curvature, parts, before, 0);
  for (int row = plane * nz; row < (plane + 1) * nz; ++row) {
    global const real* along = d + row * (nx + 2 * WIDTH) + WIDTH;
    for (int at = row * nx; at < (row + 1) * nx; at += WIDTH, along += WIDTH) {
      STORE(LOAD(u + at) + alpha * LOAD(along), u + at);
      STORE(LOAD(r + at) - alpha * LOAD(kd + at), r + at);
    }
  }
}

#if WIDTH == 1
// Both at once on a GPU: d = z + beta d_from at the 27 nodes around each, and what solid_apply does. Groups:
// rows of x (k, row of nodes); no field is wide but the modulus.
kernel __attribute__((reqd_work_group_size(GROUP, 1, 1))) void solid_advance(
    global const real* restrict stiffness, global const real* restrict modulus, global real* restrict marks,
    global const real* restrict z, global const real* restrict d_from, global real* restrict d,
    global real* restrict out, global accum* restrict partial, global const int* restrict slots,
    global const real* restrict q, global real* restrict dq, const int nx, const int nz, const int layers,
    const int parts, const int patch_row, const int before, const int turn) {
  local accum shared[GROUP];
  const int k = get_global_id(1), j = get_global_id(2), plane = nz * nx;
  const real beta =
      direction_factor(marks, parts, before, turn, get_local_id(0) == 0 && j == 0 && k == 0, shared);
  real dot = 0;
  for (int i = get_local_id(0); i < nx; i += GROUP) {
    real around[81];  // [row][z][x][component]
#pragma unroll
    for (int n = 0; n < 27; ++n) {
      const int row = j - 1 + n / 9, zz = (k + n / 3 % 3 + nz - 1) % nz, xx = (i + n % 3 + nx - 1) % nx;
      const int at = (3 * row * nz + zz) * nx + xx;
#pragma unroll
      for (int c = 0; c < 3; ++c) {
        real v = 0;
        if (row >= 0 && row < layers) {
          v = z[at + c * plane];
          if (beta != 0) v += beta * d_from[at + c * plane];
        }
        around[3 * n + c] = v;
      }
    }
    real force[3] = {0, 0, 0};
#pragma unroll
    for (int e = 0; e < 8; ++e) {
      const int ex = e % 2, ez = e / 2 % 2, ey = e / 4, layer = j - 1 + ey;
      if (layer < 0) continue;
      global const real* row = stiffness + 576 * layer + 72 * (7 - e);
      real f[3] = {0, 0, 0};
#pragma unroll
      for (int b = 0; b < 8; ++b)
#pragma unroll
        for (int c = 0; c < 3; ++c) {
          const real u = around[3 * (9 * (ey + b / 4) + 3 * (ez + b / 2 % 2) + ex + b % 2) + c];
          f[0] += row[3 * b + c] * u;
          f[1] += row[24 + 3 * b + c] * u;
          f[2] += row[48 + 3 * b + c] * u;
        }
      const real modulus_there = modulus[(layer * nz + (k + ez + nz - 1) % nz) * (nx + 2) + i + ex];
      for (int p = 0; p < 3; ++p) force[p] += modulus_there * f[p];
    }
    for (int p = 0; p < 3; ++p) {
      const int of_row = (p * nz + k) * nx + i, slot = j == patch_row ? slots[of_row] : -1;
      if (slot >= 0) {
        const real turned = q[slot] + (beta != 0 ? beta * dq[slot] : 0);
        dq[slot] = turned;
        force[p] += turned;
      }
      const real own = around[39 + p];
      d[3 * j * plane + of_row] = own;
      out[3 * j * plane + of_row] = force[p];
      dot += force[p] * own;
    }
  }
  dot = sum_of_group(dot, shared);
  if (get_local_id(0) == 0) partial[j * nz + k] = dot;
}
#endif

// to += from. Items: groups of WIDTH.
kernel void solid_add(global real* restrict to, global const real* restrict from, const int groups) {
  const int n = get_global_id(0);
  if (n < groups) STORE(LOAD(to + WIDTH * n) + LOAD(from + WIDTH * n), to + WIDTH * n);
}

// Partial sums of a . b, from `first` on: each work-group sums `chunk` groups of WIDTH numbers.
kernel OF_GROUP void solid_dot(global const real* restrict a, global const real* restrict b,
                               global accum* restrict partial, const int first, const int groups,
                               const int chunk) {
  local accum shared[GROUP];
  const int n = OWN_GROUP, begin = n * chunk, end = min(begin + chunk, groups);
  vec sum = (vec)(0);
  for (int m = begin + (int)get_local_id(0); m < end; m += GROUP)
    sum += LOAD(a + WIDTH * m) * LOAD(b + WIDTH * m);
  const accum of_chunk = sum_of_group(sum_lanes(sum), shared);
  if (get_local_id(0) == 0 && begin < groups) partial[first + n] = of_chunk;
}

// out = from + sign B^T q, or that the other way round where `of_field` is -1. The patch's row begins at
// `row` in the fields and has `unknowns`. Items: numbers of a field.
kernel void patch_add(global const int* restrict slots, global const real* restrict q,
                      global const real* restrict from, global real* restrict out, const real of_field,
                      const real sign, const int row, const int unknowns, const int size) {
  const int n = get_global_id(0);
  if (n >= size) return;
  const int slot = n >= row && n < row + unknowns ? slots[n - row] : -1;
  out[n] = of_field * from[n] + (slot >= 0 ? sign * q[slot] : 0);
}

// q = M B z0, z0 how the tissue would move by itself, and p -= alpha dq where there was an
// iteration before. Items: rows of M.
kernel void patch_project(global const real* restrict inverse, global const int* restrict unknowns,
                          global const real* restrict z, global real* restrict q,
                          global const real* restrict dq, global const real* p_from, global real* p,
                          global const real* restrict marks, const int count, const int before) {
  const int row = get_global_id(0);
  if (row >= count) return;
  global const real* of_row = inverse + row * count;
  real even = 0, odd = 0;
  int n = 0;
  for (; n + 2 <= count; n += 2) {
    even += of_row[n] * z[unknowns[n]];
    odd += of_row[n + 1] * z[unknowns[n + 1]];
  }
  if (n < count) even += of_row[n] * z[unknowns[n]];
  q[row] = even + odd;
  if (before >= 0) p[row] = p_from[row] - marks[MARKS_OF_ITERATION * before + ALPHA] * dq[row];
}

// field = sign B^T q, in unknowns begin ... end - 1 of a row of nodes that begins at `row` in the field.
kernel void patch_spread(global const int* restrict slots, global const real* restrict q,
                         global real* restrict field, const real sign, const int begin, const int end,
                         const int row) {
  const int n = begin + get_global_id(0);
  if (n < end) field[row + n] = slots[n] >= 0 ? sign * q[slots[n]] : 0;
}
