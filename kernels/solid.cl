// Solid elasticity on hexahedra (T8) and conjugate gradients for a touched block:
// service/tissue/solid/solid_solver.h. An iteration is, on processors, solid_step, the preconditioner's
// launches with patch_project and patch_spread between them, solid_dot, solid_direction and solid_apply; on
// GPUs those of solid_groups.cl, and solid_advance.
//
// Fields: [plane = 3 row + component][z][x]. On processors those that K is applied to are *wide*: after each
// row of x come WIDTH numbers of its beginning, and there is one more row of nodes, the held one, of zeros.
#include "solid_marks.clh"

#ifndef ALONG  // z and rows of nodes of an item of solid_apply
#define ALONG 8
#define DOWN 4
#endif

// The patch: `unknowns` says where in a field it is, all in the three planes of one row of nodes, `slots` of
// each unknown of that row its number in the patch or -1. Those whose skins bear q give way by C q. M = (S0 +
// C)^-1, dense. dq: the patch's part of a direction.

// An element acts by parity (service/tissue/solid/solid_tissue.h): on sums over its corners in which the far
// ones along x, y or z count as they are, and the near ones with the opposite sign where the parity is odd
// there: bit 0 for x, 1 for y, 2 for z. Of K_e there remain 39 numbers of 576.

// Of the nodes around a side that faces z, and one component: [parity in x and y]. d: the component's plane.
void side_parities(global const real* restrict d, const int plane, vec* restrict side) {
  const vec a = LOAD(d), b = LOAD(d + 1), c = LOAD(d + 3 * plane), e = LOAD(d + 3 * plane + 1);
  const vec upper = a + b, upper_x = b - a, lower = c + e, lower_x = e - c;
  side[0] = upper + lower, side[1] = upper_x + lower_x;
  side[2] = lower - upper, side[3] = lower_x - upper_x;
}

// f = e K_e u, both [component][parity]. Of a layer's blocks only those numbers are read that are not zero.
void element_forces(global const real* restrict blocks, const vec e, const vec* restrict u, vec* restrict f) {
#pragma unroll
  for (int s = 0; s < 8; ++s)
#pragma unroll
    for (int p = 0; p < 3; ++p) {
      vec sum = (vec)(0);
#pragma unroll
      for (int q = 0; q < 3; ++q)
        if (p == q ? s != 1 << p : s == 0 || (s >> p & s >> q & 1))
          sum += blocks[9 * s + 3 * p + q] * u[8 * q + (s ^ 1 << q)];
      f[8 * p + (s ^ 1 << p)] = e * sum;
    }
}

// out = K d + B^T dq and partial sums of d . that, one of each row of x. stiffness: of each layer 8 blocks of
// 3 x 3 for a modulus of 1; patch_row: -1 where no dq is. Items: blocks of ALONG z by DOWN rows of nodes. An
// element is computed once in each block that it has nodes in, and a node's sum is the same in any: of the
// elements before it in z, then beyond it; of each the one above, then below. 186 flops a node.
kernel void solid_apply(global const real* restrict stiffness, global const real* restrict modulus,
                        global const real* restrict d, global real* restrict out,
                        global accum* restrict partial, global const int* restrict slots,
                        global const real* restrict dq, const int nx, const int nz, const int layers,
                        const int patch_row) {
  const int begin = ALONG * get_global_id(0), end = min(begin + ALONG, nz);
  const int top = DOWN * get_global_id(1), bottom = min(top + DOWN, layers);
  if (begin >= nz || top >= layers) return;
  const int wide = nx + WIDTH, plane = nz * wide;
  for (int i = 0; i < nx; i += WIDTH) {
    vec hanging[6 * ALONG];  // of the layer above, on the nodes below it: [z][component][parity in x]
    for (int n = 0; n < 6 * ALONG; ++n) hanging[n] = (vec)(0);
    for (int layer = max(top - 1, 0); layer < bottom; ++layer) {
      global const real* of_layer = d + 3 * layer * plane + i;
      vec near[12], before[12];  // the nodes at k, and the forces there of the element before
      for (int n = 0; n < 12; ++n) before[n] = (vec)(0);
      for (int p = 0; p < 3; ++p)
        side_parities(of_layer + p * plane + (begin == 0 ? nz - 1 : begin - 1) * wide, plane, near + 4 * p);
      for (int k = begin - 1; k < end; ++k) {
        const int z = k < 0 ? nz - 1 : k, beyond = k + 1 == nz ? 0 : k + 1;
        vec u[24], f[24];
#pragma unroll
        for (int p = 0; p < 3; ++p) {
          vec far[4];
          side_parities(of_layer + p * plane + beyond * wide, plane, far);
#pragma unroll
          for (int s = 0; s < 4; ++s) {
            u[8 * p + s] = far[s] + near[4 * p + s];
            u[8 * p + 4 + s] = far[s] - near[4 * p + s];
            near[4 * p + s] = far[s];
          }
        }
        const vec e = LOAD(modulus + (layer * nz + z) * nx + i);
        element_forces(stiffness + 72 * layer, e, u, f);
#pragma unroll
        for (int p = 0; p < 3; ++p) {
          vec side[4];
#pragma unroll
          for (int s = 0; s < 4; ++s) {
            side[s] = before[4 * p + s] + (f[8 * p + s] - f[8 * p + 4 + s]);
            before[4 * p + s] = f[8 * p + s] + f[8 * p + 4 + s];
          }
          if (k < begin) continue;
          vec* above = hanging + 6 * (k - begin) + 2 * p;
          const vec even = above[0] + (side[0] - side[2]), odd = above[1] + (side[1] - side[3]);
          above[0] = side[0] + side[2], above[1] = side[1] + side[3];
          if (layer < top) continue;
          // What acts on the far nodes in x belongs a lane further, the last one to the next vector.
          global real* row = out + ((3 * layer + p) * nz + k) * nx;
          const vec far = even + odd;
          vec from_left = far;
#pragma unroll
          for (int lane = 1; lane < WIDTH; ++lane) ((real*)&from_left)[lane] = ((const real*)&far)[lane - 1];
          ((real*)&from_left)[0] = i == 0 ? 0 : row[i];
          STORE(even - odd + from_left, row + i);
          const real last = ((const real*)&far)[WIDTH - 1];
          if (i + WIDTH < nx)
            row[i + WIDTH] = last;
          else
            row[0] += last;
        }
      }
    }
  }
  for (int j = top; j < bottom; ++j)
    for (int k = begin; k < end; ++k) {
      vec dot = (vec)(0);
      for (int p = 0; p < 3; ++p) {
        const int row = (3 * j + p) * nz + k;
        global real* force = out + row * nx;
        global const int* slot = slots + (p * nz + k) * nx;
        for (int i = 0; j == patch_row && i < nx; ++i)
          if (slot[i] >= 0) force[i] += dq[slot[i]];
        for (int i = 0; i < nx; i += WIDTH) dot += LOAD(force + i) * LOAD(d + row * wide + i);
      }
      partial[j * nz + k] = sum_lanes(dot);
    }
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
      global real* to = d + row * (nx + WIDTH) + n;
      vec v = LOAD(z + row * nx + n);
      if (beta != 0) v += beta * LOAD(to);
      STORE(v, to);
      if (n == 0) STORE(v, to + nx);
    }
  if (patch_row < 0 || plane / 3 != patch_row) return;
  for (int n = plane % 3 * nz * nx; n < (plane % 3 + 1) * nz * nx; ++n)
    if (slots[n] >= 0) dq[slots[n]] = q[slots[n]] + (beta != 0 ? beta * dq[slots[n]] : 0);
}

// u += alpha d, r -= alpha K d; d is wide. Items: planes.
kernel void solid_step(global const real* restrict d, global const real* restrict kd, global real* restrict u,
                       global real* restrict r, global const accum* restrict curvature,
                       global real* restrict marks, const int nx, const int nz, const int planes,
                       const int parts, const int before) {
  const int plane = get_global_id(0);
  if (plane >= planes) return;
  const real alpha = step_length(marks, curvature, parts, before, 0);
  for (int row = plane * nz; row < (plane + 1) * nz; ++row) {
    global const real* along = d + row * (nx + WIDTH);
    for (int at = row * nx; at < (row + 1) * nx; at += WIDTH, along += WIDTH) {
      STORE(LOAD(u + at) + alpha * LOAD(along), u + at);
      STORE(LOAD(r + at) - alpha * LOAD(kd + at), r + at);
    }
  }
}

#if WIDTH == 1
// Both at once on a GPU: d = z + beta d_from at the 27 nodes around each, and what solid_apply does. Groups:
// rows of x (k, row of nodes). stiffness: of each layer 24 x 24. No field is wide. 1152 flops a node.
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
      const int there = (layer * nz + (k + ez + nz - 1) % nz) * nx + (i + ex + nx - 1) % nx;
      for (int p = 0; p < 3; ++p) force[p] += modulus[there] * f[p];
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
