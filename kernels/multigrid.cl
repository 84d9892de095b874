// Geometric multigrid: the steps of a cycle, each on one level. On large levels a step is a launch; a run of
// steps on small ones is a launch of one work-group for each right-hand side (`run_steps`).
#include "levels.clh"

// Work-group size of run_steps.
#ifndef GROUP
#define GROUP 256
#endif

// Steps, as in service/solver/cycle_plan.h.
#define STEP_RESIDUAL 0
#define STEP_SMOOTH 1
#define STEP_SMOOTH_FROM_ZERO 2
#define STEP_RESTRICT 3
#define STEP_PROLONG 4
#define STEP_SOLVE 5

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

// Right-hand side of the next level = P^T residual, over its nodes and those between rows. P is bilinear on
// coarse lines, and its blocks (kernels/galerkin.cl, inside_blocks) at the nodes inside coarse cells. Coarse
// line I lies on fine line at[I]; the fine lines just before and after it, where they are not coarse
// themselves, belong to it with weights around[I] = (before, after).
void restrict_at(global const real* constants, global real* vectors, global const int* table,
                 const Level level, const Level next, const int item) {
  const int i = item % next.pitch, j = item / next.pitch, n = first_node(next) + item;
  if (i >= next.nx) return;
  const int pitch = level.pitch, from = pitch * (table[level.at_y + j] + 1) + table[level.at_x + i] + 1;
  global const real* x = vectors + level.vectors + RESIDUAL * level.stride + from;
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
  global real* right = vectors + next.vectors + RIGHT * next.stride + n;
  global const real* free = constants + next.free + n;
  right[0] = free[0] * sum_x;
  right[next.stride] = free[next.stride] * sum_y;
}

// Correction += P times the next level's. Items as above: each brings what belongs to the fine node at its
// place, to the dropped line before the next column and row, and to the node inside the cell between.
void prolong_at(global const real* constants, global real* vectors, global const int* table,
                const Level level, const Level next, const int item) {
  const int i = item % next.pitch, j = item / next.pitch, n = first_node(next) + item;
  if (i >= next.nx) return;
  const int pitch = level.pitch, stride = level.stride;
  const int to = pitch * (table[level.at_y + j] + 1) + table[level.at_x + i] + 1;
  const bool dropped_x = constants[level.around_x + 2 * i + 1] != 0;
  const bool dropped_y = constants[level.around_y + 2 * j + 1] != 0;
  for (int c = 0; c < 2; ++c) {
    global const real* from = vectors + next.vectors + (CORRECTION + c) * next.stride + n;
    global real* z = vectors + level.vectors + (CORRECTION + c) * stride + to;
    global const real* free = constants + level.free + c * stride + to;
    z[0] += free[0] * from[0];
    if (dropped_x) {
      const real w = constants[level.around_x + 2 * i + 1];
      z[1] += free[1] * (w * from[0] + (1 - w) * from[1]);
    }
    if (dropped_y) {
      const real w = constants[level.around_y + 2 * j + 1];
      z[pitch] += free[pitch] * (w * from[0] + (1 - w) * from[next.pitch]);
    }
  }
  if (!dropped_x || !dropped_y) return;
  global const real* x = vectors + next.vectors + CORRECTION * next.stride + n;
  global const real* y = x + next.stride;
  real sum_x = 0, sum_y = 0;
#pragma unroll
  for (int p = 0; p < 4; ++p) {
    const int corner = p % 2 + p / 2 * next.pitch;
    global const real* block = constants + level.inside + 4 * p * next.stride + n;
    sum_x += block[0] * x[corner] + block[next.stride] * y[corner];
    sum_y += block[2 * next.stride] * x[corner] + block[3 * next.stride] * y[corner];
  }
  global real* inside = vectors + level.vectors + CORRECTION * stride + to + 1 + pitch;
  inside[0] += sum_x;
  inside[stride] += sum_y;
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
  const int item = get_global_id(0);
  if (item >= span(next)) return;
  restrict_at(constants, vectors + get_global_id(1) * vectors_size, table, level_of(table, index), next,
              item);
}

kernel void prolong_add(global const real* constants, global real* vectors, global const int* table,
                        const int index, const int vectors_size) {
  const Level next = level_of(table, index + 1);
  const int item = get_global_id(0);
  if (item >= span(next)) return;
  prolong_at(constants, vectors + get_global_id(1) * vectors_size, table, level_of(table, index), next, item);
}

// Steps `from` to `to` - 1 of the plan at `plan` in the table, (step, level, k) each, by one work-group for
// each right-hand side.
kernel __attribute__((reqd_work_group_size(GROUP, 1, 1))) void run_steps(
    global const real* constants, global real* vectors, global const int* table, const int plan,
    const int from, const int to, const int vectors_size) {
  const int first = get_local_id(0);
  vectors += get_group_id(1) * vectors_size;
  for (int s = from; s < to; ++s) {
    const int step = table[plan + 3 * s], index = table[plan + 3 * s + 1], k = table[plan + 3 * s + 2];
    const Level level = level_of(table, index);
    if (step == STEP_RESIDUAL)
      for (int item = first; item < blocks(level); item += GROUP)
        residual_at(constants, vectors, level, item);
    if (step == STEP_SMOOTH || step == STEP_SMOOTH_FROM_ZERO)
      for (int item = first; item < blocks(level); item += GROUP)
        smooth_at(constants, vectors, level, k, step == STEP_SMOOTH_FROM_ZERO, item);
    if (step == STEP_RESTRICT || step == STEP_PROLONG) {
      const Level next = level_of(table, index + 1);
      for (int item = first; item < span(next); item += GROUP)
        if (step == STEP_RESTRICT)
          restrict_at(constants, vectors, table, level, next, item);
        else
          prolong_at(constants, vectors, table, level, next, item);
    }
    if (step == STEP_SOLVE)
      for (int item = first; item < 2 * blocks(level); item += GROUP)
        solve_at(constants, vectors, level, item);
    barrier(CLK_GLOBAL_MEM_FENCE);
  }
}
