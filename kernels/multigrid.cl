// Geometric multigrid: the steps of a cycle, each on one level. On large levels a step is a launch; a run of
// steps on small ones is a launch of one work-group for each right-hand side (`run_steps`).
#include "levels.clh"

// Work-group size of run_steps.
#ifndef GROUP
#define GROUP 256
#endif

// What the vectors that come and go are made of: `real`, or double.
#ifndef OUTER
#define OUTER real
#endif

// Steps, as in service/solver/level_layout.h.
#define STEP_RESIDUAL 0
#define STEP_SMOOTH 1
#define STEP_SMOOTH_FROM_ZERO 2
#define STEP_RESTRICT 3
#define STEP_PROLONG 4
#define STEP_SOLVE 5
#define STEP_PACK 6
#define STEP_UNPACK 7

// residual = right - A correction at WIDTH nodes.
void residual_at(global const real* constants, global real* vectors, const Level level, const int item) {
  const int n = first_node(level) + WIDTH * item, stride = level.stride;
  global real* v = vectors + level.vectors;
  const Vec2 sum = stencil_times(constants + level.stencil, v + CORRECTION * stride, n, level.pitch, stride);
  STORE(LOAD(v + RIGHT * stride + n) - sum.x, v + RESIDUAL * stride + n);
  STORE(LOAD(v + (RIGHT + 1) * stride + n) - sum.y, v + (RESIDUAL + 1) * stride + n);
}

// Chebyshev step k: d = c_old d + c_new M residual, correction += d; from_zero: correction = d and the
// residual is the right-hand side. M: the stencil of cells.cl. constants begin with the steps' (c_old,
// c_new).
void smooth_at(global const real* constants, global real* vectors, const Level level, const int k,
               const int from_zero, const int item) {
  const int n = first_node(level) + WIDTH * item, stride = level.stride;
  global real* v = vectors + level.vectors;
  const Vec2 sum = stencil_times(constants + level.smoother, v + (from_zero ? RIGHT : RESIDUAL) * stride, n,
                                 level.pitch, stride);
  const real c_old = constants[2 * k], c_new = constants[2 * k + 1];
  global real* d = v + DIRECTION * stride + n;
  global real* z = v + CORRECTION * stride + n;
  vec x = c_new * sum.x, y = c_new * sum.y;
  if (k > 0) {
    x += c_old * LOAD(d);
    y += c_old * LOAD(d + stride);
  }
  STORE(x, d);
  STORE(y, d + stride);
  STORE(from_zero ? x : LOAD(z) + x, z);
  STORE(from_zero ? y : LOAD(z + stride) + y, z + stride);
}

// Right-hand side from a vector [node][2], and the correction into one.
void pack_at(global const OUTER* restrict from, global real* restrict vectors, const Level level,
             const Columns part) {
  global real* right = vectors + level.vectors + RIGHT * level.stride + first_node(level);
  for (int i = part.begin; i < part.end; ++i) {
    const int node = i + level.nx * part.j, n = i + level.pitch * part.j;
    right[n] = from[2 * node];
    right[level.stride + n] = from[2 * node + 1];
  }
}

void unpack_at(global const real* restrict vectors, global OUTER* restrict to, const Level level,
               const Columns part) {
  global const real* z = vectors + level.vectors + CORRECTION * level.stride + first_node(level);
  for (int i = part.begin; i < part.end; ++i) {
    const int node = i + level.nx * part.j, n = i + level.pitch * part.j;
    to[2 * node] = z[n];
    to[2 * node + 1] = z[level.stride + n];
  }
}

// Right-hand side of the next level at its node (i, j) = P^T residual. P is bilinear on coarse lines, and its
// blocks (kernels/galerkin.cl, inside_blocks) at the nodes inside coarse cells. Coarse line I lies on fine
// line at[I]; the fine lines just before and after it, where they are not coarse themselves, belong to it
// with weights around[I] = (before, after). x: residual at the fine node in its place.
void restrict_node(global const real* restrict constants, global const real* restrict x,
                   global real* restrict right, const Level level, const Level next, const int i,
                   const int j) {
  const int pitch = level.pitch, n = first_node(next) + next.pitch * j + i;
  global const real* y = x + level.stride;
  global const real* wx = constants + level.around_x + 2 * i;
  global const real* wy = constants + level.around_y + 2 * j;
  real sum_x = x[0] + wx[0] * x[-1] + wx[1] * x[1] + wy[0] * x[-pitch] + wy[1] * x[pitch];
  real sum_y = y[0] + wx[0] * y[-1] + wx[1] * y[1] + wy[0] * y[-pitch] + wy[1] * y[pitch];
#pragma unroll
  for (int cell = 0; cell < 4; ++cell) {  // the four around: before or after in x (bit 0) and in y (bit 1)
    const int a = cell % 2, b = cell / 2, to = 2 * a - 1 + (2 * b - 1) * pitch;
    global const real* block =
        constants + level.inside + 4 * (3 - cell) * next.stride + n - (1 - a) - (1 - b) * next.pitch;
    sum_x += block[0] * x[to] + block[2 * next.stride] * y[to];
    sum_y += block[next.stride] * x[to] + block[3 * next.stride] * y[to];
  }
  global const real* free = constants + next.free + n;
  right[n] = free[0] * sum_x;
  right[next.stride + n] = free[next.stride] * sum_y;
}

// Over columns of the next level. Those on every second fine one go first: their places follow one another.
void restrict_at(global const real* constants, global real* vectors, global const int* table,
                 const Level level, const Level next, const Columns part) {
  if (part.begin >= part.end) return;
  global const real* x = vectors + level.vectors + RESIDUAL * level.stride + first_node(level) +
                         level.pitch * table[level.at_y + part.j];
  global real* right = vectors + next.vectors + RIGHT * next.stride;
  const int halved = min(level.halved, part.end);
  for (int i = part.begin; i < halved; ++i)
    restrict_node(constants, x + 2 * i, right, level, next, i, part.j);
  for (int i = max(halved, part.begin); i < part.end; ++i)
    restrict_node(constants, x + table[level.at_x + i], right, level, next, i, part.j);
}

// The four fine nodes of coarse node (i, j): correction += P times the next level's, on the fine node in its
// place, on the dropped lines before the next column and row, and inside the cell between. z: correction at
// the first, from: the next level's at (i, j).
void prolong_node(global const real* restrict constants, global const real* restrict from,
                  global real* restrict z, const Level level, const Level next, const int free_at,
                  const int block_at, const real wx, const real wy, const bool dropped_x,
                  const bool dropped_y) {
  const int pitch = level.pitch, stride = level.stride, below = next.pitch;
  global const real* x = from;
  global const real* y = from + next.stride;
  global const real* free = constants + free_at;
  z[0] += free[0] * x[0];
  z[stride] += free[stride] * y[0];
  if (dropped_x) {
    z[1] += free[1] * (wx * x[0] + (1 - wx) * x[1]);
    z[stride + 1] += free[stride + 1] * (wx * y[0] + (1 - wx) * y[1]);
  }
  if (dropped_y) {
    z[pitch] += free[pitch] * (wy * x[0] + (1 - wy) * x[below]);
    z[stride + pitch] += free[stride + pitch] * (wy * y[0] + (1 - wy) * y[below]);
  }
  if (!dropped_x || !dropped_y) return;
  real sum_x = 0, sum_y = 0;
#pragma unroll
  for (int p = 0; p < 4; ++p) {
    const int corner = p % 2 + p / 2 * below;
    global const real* block = constants + block_at + 4 * p * next.stride;
    sum_x += block[0] * x[corner] + block[next.stride] * y[corner];
    sum_y += block[2 * next.stride] * x[corner] + block[3 * next.stride] * y[corner];
  }
  z[pitch + 1] += sum_x;
  z[stride + pitch + 1] += sum_y;
}

// Over columns of the next level, as above.
void prolong_at(global const real* constants, global real* vectors, global const int* table,
                const Level level, const Level next, const Columns part) {
  if (part.begin >= part.end) return;
  const int fine = first_node(level) + level.pitch * table[level.at_y + part.j];
  const int coarse = first_node(next) + next.pitch * part.j;
  global real* z = vectors + level.vectors + CORRECTION * level.stride + fine;
  global const real* from = vectors + next.vectors + CORRECTION * next.stride + coarse;
  global const real* around = constants + level.around_x + 1;  // [2 i]: of the line after coarse column i
  const real wy = constants[level.around_y + 2 * part.j + 1];
  const int free_at = level.free + fine, block_at = level.inside + coarse;
  const int halved = min(level.halved, part.end);
  if (wy != 0)
    for (int i = part.begin; i < halved; ++i)
      prolong_node(constants, from + i, z + 2 * i, level, next, free_at + 2 * i, block_at + i, around[2 * i],
                   wy, true, true);
  else
    for (int i = part.begin; i < halved; ++i)
      prolong_node(constants, from + i, z + 2 * i, level, next, free_at + 2 * i, block_at + i, around[2 * i],
                   wy, true, false);
  for (int i = max(halved, part.begin); i < part.end; ++i) {
    const int at = table[level.at_x + i];
    prolong_node(constants, from + i, z + at, level, next, free_at + at, block_at + i, around[2 * i], wy,
                 around[2 * i] != 0, wy != 0);
  }
}

// The coarsest level: correction = dense inverse times right. Symmetric, [2 nodes][2][row of nodes]; nodes
// between rows count, rows are of whole WIDTHs. Items: WIDTH nodes of one component.
void solve_at(global const real* constants, global real* vectors, const Level level, const int item) {
  const int nodes = span(level), blocks = (nodes + WIDTH - 1) / WIDTH, row = WIDTH * blocks;
  const int component = item / blocks, at = WIDTH * (item % blocks), stride = level.stride;
  global const real* matrix = constants + level.stencil + component * row + at;
  global const real* r = vectors + level.vectors + RIGHT * stride + first_node(level);
  vec x = 0, y = 0;
  for (int m = 0; m < nodes; ++m) {
    x += LOAD(matrix + 2 * m * row) * r[m];
    y += LOAD(matrix + 2 * (nodes + m) * row) * r[stride + m];
  }
  STORE(x + y, vectors + level.vectors + (CORRECTION + component) * stride + first_node(level) + at);
}

// Work items of a step; those that move between levels run over the next, coarser one.
int blocks(const Level level) {
  return (span(level) + WIDTH - 1) / WIDTH;
}

// A step each. Items: (those of the step, right-hand side); `vectors_size`: reals of one right-hand side.
kernel void residual(global const real* constants, global real* vectors, global const int* table,
                     const int index, const int vectors_size) {
  const Level level = level_of(table, index);
  const int item = get_global_id(0);
  if (item >= blocks(level)) return;
  residual_at(constants, vectors + get_global_id(1) * vectors_size, level, item);
}

kernel void smooth(global const real* constants, global real* vectors, global const int* table,
                   const int index, const int vectors_size, const int k, const int from_zero) {
  const Level level = level_of(table, index);
  const int item = get_global_id(0);
  if (item >= blocks(level)) return;
  smooth_at(constants, vectors + get_global_id(1) * vectors_size, level, k, from_zero, item);
}

kernel void restrict_residual(global const real* constants, global real* vectors, global const int* table,
                              const int index, const int vectors_size) {
  const Level next = level_of(table, index + 1);
  restrict_at(constants, vectors + get_global_id(1) * vectors_size, table, level_of(table, index), next,
              columns_of(next, get_global_id(0)));
}

kernel void prolong_add(global const real* constants, global real* vectors, global const int* table,
                        const int index, const int vectors_size) {
  const Level next = level_of(table, index + 1);
  prolong_at(constants, vectors + get_global_id(1) * vectors_size, table, level_of(table, index), next,
             columns_of(next, get_global_id(0)));
}

// Vectors [right-hand side][node][2] in and out of the finest level's planes.
kernel void vectors_to_planes(global const OUTER* r, global real* vectors, global const int* table,
                              const int vectors_size) {
  const Level level = level_of(table, 0);
  pack_at(r + get_global_id(1) * 2 * level.nx * level.ny, vectors + get_global_id(1) * vectors_size, level,
          columns_of(level, get_global_id(0)));
}

kernel void planes_to_vectors(global const real* vectors, global OUTER* z, global const int* table,
                              const int vectors_size) {
  const Level level = level_of(table, 0);
  unpack_at(vectors + get_global_id(1) * vectors_size, z + get_global_id(1) * 2 * level.nx * level.ny, level,
            columns_of(level, get_global_id(0)));
}

// Steps `from` to `to` - 1 of the plan at `plan` in the table, (step, level, k) each, by one work-group for
// each right-hand side; r and z: vectors [right-hand side][node][2] that a whole cycle takes and gives.
kernel __attribute__((reqd_work_group_size(GROUP, 1, 1))) void run_steps(
    global const real* constants, global real* vectors, global const int* table, global const OUTER* r,
    global OUTER* z, const int plan, const int from, const int to, const int vectors_size) {
  const int first = get_local_id(0), q = get_global_id(1);  // a launch may come in slices
  vectors += q * vectors_size;
  for (int s = from; s < to; ++s) {
    const int step = table[plan + 3 * s], index = table[plan + 3 * s + 1], k = table[plan + 3 * s + 2];
    const Level level = level_of(table, index);
    const int unknowns = 2 * level.nx * level.ny;
    if (step == STEP_RESIDUAL)
      for (int item = first; item < blocks(level); item += GROUP)
        residual_at(constants, vectors, level, item);
    if (step == STEP_SMOOTH || step == STEP_SMOOTH_FROM_ZERO)
      for (int item = first; item < blocks(level); item += GROUP)
        smooth_at(constants, vectors, level, k, step == STEP_SMOOTH_FROM_ZERO, item);
    if (step == STEP_RESTRICT || step == STEP_PROLONG) {
      const Level next = level_of(table, index + 1);
      for (int item = first; item < row_items(next); item += GROUP)
        if (step == STEP_RESTRICT)
          restrict_at(constants, vectors, table, level, next, columns_of(next, item));
        else
          prolong_at(constants, vectors, table, level, next, columns_of(next, item));
    }
    if (step == STEP_SOLVE)
      for (int item = first; item < 2 * blocks(level); item += GROUP)
        solve_at(constants, vectors, level, item);
    if (step == STEP_PACK)
      for (int item = first; item < row_items(level); item += GROUP)
        pack_at(r + q * unknowns, vectors, level, columns_of(level, item));
    if (step == STEP_UNPACK)
      for (int item = first; item < row_items(level); item += GROUP)
        unpack_at(vectors, z + q * unknowns, level, columns_of(level, item));
    barrier(CLK_GLOBAL_MEM_FENCE);
  }
}
