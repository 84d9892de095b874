// Conjugate gradients on a narrow grid, a whole solve in one launch: a work-group for each WIDTH right-hand
// sides, which are the lanes of a vector (one on a GPU, where the group shares out the unknowns).
//
// Across its short side the grid's lines of nodes are blocks of a block tridiagonal operator: D of their own,
// E to the next. The preconditioner is its inverse, rounded: S_s = D_s - E_(s-1)^T S_(s-1)^-1 E_(s-1) are
// inverted beforehand (service/tissue/block_tridiagonal.cpp), so that r . z is about the squared energy norm
// of the error.
//
// Unknown u = s size + 2 j + component of node j of line s. rows: [18][unknown], entry 6 (ds + 1) +
// 2 (dj + 1) + c towards component c of node (s + ds, j + dj), zero where none is; those of the node itself
// hold the sum over all nine, as the operator is formed from differences (levels.clh says why). inverses:
// [block][tile of ROWS rows][column][row in the tile], zero beyond `size`.
#include "pcg.clh"
#include "sums.clh"

#define ROWS 8     // of a tile
#define EDGE 2     // zeros beside a block's vector: the neighbours that its first and last node do not have
#define MOST 128   // unknowns of a block
#define AT_ONCE 4  // of a row's parts, sums of the others

typedef struct {
  int steps, size, padded;  // blocks; unknowns of one, and these in whole tiles
  int along, across;        // from node to node of the grid: to the next block, within one
  int rhs;
} Shape;

// Planes of [unknown] that a group works on.
#define X 0
#define R 1
#define P 2
#define Z 3
#define FORCE 4  // the load
#define PLANES 5

// What a group shares.
#define SHARED                                               \
  local vec in[MOST], last[MOST + 2 * EDGE], partial[GROUP]; \
  local accum shared[GROUP];                                 \
  const Group group = {in, last, partial, shared}
typedef struct {
  local vec *in, *last, *partial;
  local accum* shared;
} Group;

int unknowns(const Shape shape) {
  return shape.steps * shape.size;
}

vec total(const vec own, const Group group) {
#if GROUP == 1
  return own;
#else
  return sum_of_group(own, group.shared);
#endif
}

// Of a vector [right-hand side][node][2] those of this group.
vec packed(global const real* from, const Shape shape, const int u) {
  const int k = u % shape.size, to = 2 * (u / shape.size * shape.along + k / 2 * shape.across) + k % 2;
  real lanes[WIDTH];
  for (int lane = 0; lane < WIDTH; ++lane) {
    const int q = OWN_GROUP * WIDTH + lane;
    lanes[lane] = q < shape.rhs ? from[q * unknowns(shape) + to] : 0;
  }
  return LOAD(lanes);
}

void unpack(const vec value, global real* to, const Shape shape, const int u) {
  const int k = u % shape.size, at = 2 * (u / shape.size * shape.along + k / 2 * shape.across) + k % 2;
  real lanes[WIDTH];
  STORE(value, lanes);
  for (int lane = 0; lane < WIDTH; ++lane) {
    const int q = OWN_GROUP * WIDTH + lane;
    if (q < shape.rhs) to[q * unknowns(shape) + at] = lanes[lane];
  }
}

// last = inverse times in. Every item of the group calls it, behind a barrier.
void times_inverse(global const real* inverse, const Shape shape, const Group group) {
  local vec* out = group.last + EDGE;
#if GROUP == 1
  for (int row = 0; row < shape.padded; row += ROWS) {
    vec sum[ROWS];
#pragma unroll
    for (int k = 0; k < ROWS; ++k) sum[k] = 0;
    global const real* tile = inverse + row * shape.size;
    for (int c = 0; c < shape.size; ++c, tile += ROWS) {
      const vec v = group.in[c];
#pragma unroll
      for (int k = 0; k < ROWS; ++k) sum[k] = fma((vec)(tile[k]), v, sum[k]);
    }
#pragma unroll
    for (int k = 0; k < ROWS; ++k) out[row + k] = sum[k];
  }
#else
  const int item = get_local_id(0), row = item % shape.padded, part = item / shape.padded;
  const int parts = GROUP / shape.padded;
  vec sum = 0;
  for (int c = part; part < parts && c < shape.size; c += parts)
    sum += inverse[(row / ROWS * shape.size + c) * ROWS + row % ROWS] * group.in[c];
  group.partial[item] = sum;
  barrier(CLK_LOCAL_MEM_FENCE);
  if (part < AT_ONCE) {
    for (int n = part + AT_ONCE; n < parts; n += AT_ONCE) sum += group.partial[row + n * shape.padded];
    group.partial[item] = sum;
  }
  barrier(CLK_LOCAL_MEM_FENCE);
  if (part != 0) return;
  for (int n = 1; n < min(parts, AT_ONCE); ++n) sum += group.partial[row + n * shape.padded];
  out[row] = sum;
#endif
}

// What unknown k of a block gets from the neighbouring one, whose unknowns are in `last`.
vec coupled(global const real* entries, const Group group, const int k, const int count) {
  local const vec* from = group.last + k - k % 2;
  vec sum = 0;
#pragma unroll
  for (int e = 0; e < 6; ++e) sum += entries[e * count] * from[e];
  return sum;
}

// z = M r; r . z to every item.
vec precondition(global const real* rows, global const real* inverses, global const vec* r, global vec* z,
                 const Shape shape, const Group group) {
  const int first = get_local_id(0), size = shape.size, count = unknowns(shape);
  for (int k = first; k < MOST + 2 * EDGE; k += GROUP) group.last[k] = 0;
  barrier(CLK_LOCAL_MEM_FENCE | CLK_GLOBAL_MEM_FENCE);
  for (int s = 0; s < shape.steps; ++s) {
    for (int k = first; k < size; k += GROUP) {
      const int u = s * size + k;
      const vec left = r[u] - coupled(rows + u, group, k, count);
      group.in[k] = left;
      z[u] = left;
    }
    barrier(CLK_LOCAL_MEM_FENCE);
    times_inverse(inverses + s * size * shape.padded, shape, group);
    barrier(CLK_LOCAL_MEM_FENCE);
  }
  vec product = 0;
  for (int s = shape.steps - 1; s >= 0; --s) {
    if (s + 1 < shape.steps) {
      for (int k = first; k < size; k += GROUP) {
        const int u = s * size + k;
        group.in[k] = z[u] - coupled(rows + 12 * count + u, group, k, count);
      }
      barrier(CLK_LOCAL_MEM_FENCE);
      times_inverse(inverses + s * size * shape.padded, shape, group);
      barrier(CLK_LOCAL_MEM_FENCE);
    }
    for (int k = first; k < size; k += GROUP) {
      const int u = s * size + k;
      z[u] = group.last[EDGE + k];
      product += r[u] * z[u];
    }
  }
  barrier(CLK_GLOBAL_MEM_FENCE);
  return total(product, group);
}

// (A x) of unknown u. A neighbour that does not exist is the node itself.
vec times_operator(global const real* rows, global const vec* x, const Shape shape, const int u) {
  const int size = shape.size, count = unknowns(shape), s = u / size, k = u % size, node = u - k % 2;
  const vec own_x = x[node], own_y = x[node + 1];
  vec sum = rows[8 * count + u] * own_x + rows[9 * count + u] * own_y;
#pragma unroll
  for (int n = 0; n < 9; ++n) {
    if (n == 4) continue;
    const int ds = n / 3 - 1, dj = n % 3 - 1;
    const bool exists = s + ds >= 0 && s + ds < shape.steps && k / 2 + dj >= 0 && k / 2 + dj < size / 2;
    const int at = exists ? node + ds * size + 2 * dj : node;
    sum += rows[2 * n * count + u] * (x[at] - own_x) + rows[(2 * n + 1) * count + u] * (x[at + 1] - own_y);
  }
  return sum;
}

// Of one lane; what pcg.clh names.
typedef struct {
  real rz, rr, start, decrease, work, estimate, initial, scale, absolute;
  int state, iterations;
} Lane;

Lane begin(global const real* scalars, const int q, const int rhs, const real rz, const real rr) {
  const real initial = q < rhs ? scalars[INITIAL * rhs + q] : 0,
             absolute = q < rhs ? scalars[ABSOLUTE * rhs + q] : 0;
  const Lane lane = {
      rz,
      rr,
      rr,
      0,
      0,
      0,
      initial,
      initial,
      absolute,
      !isfinite(rz) || !isfinite(rr) ? NOT_FINITE : rr == 0 ? CONVERGED : rz <= 0 ? INDEFINITE : RUNNING,
      0};
  return lane;
}

// The length of the step along p.
real step_of(Lane* lane, const real curvature, const real work) {
  if (lane->state == RUNNING && !isfinite(curvature)) lane->state = NOT_FINITE;
  if (lane->state == RUNNING && curvature <= 0) lane->state = INDEFINITE;
  if (lane->state != RUNNING) return 0;
  const real alpha = lane->rz / curvature;
  lane->decrease += alpha * lane->rz;
  lane->work += alpha * work;
  lane->iterations += 1;
  return alpha;
}

// After the last iteration, where no preconditioner says what is left.
void end(Lane* lane, const real rr) {
  if (lane->state != RUNNING) return;
  lane->rr = rr;
  lane->estimate = INFINITY;
  lane->scale = lane->initial + 2 * lane->work - lane->decrease;
  if (!isfinite(rr)) lane->state = NOT_FINITE;
}

// After it: whether to stop; how much of p goes on.
real judge(Lane* lane, const real rr, const real rz, const real squared_tolerance) {
  if (lane->state != RUNNING) return 0;
  const real beta = rz / lane->rz;
  lane->rr = rr;
  lane->rz = rz;
  lane->estimate = rz;
  lane->scale = lane->initial + 2 * lane->work - lane->decrease;
  if (!isfinite(rr) || !isfinite(rz))
    lane->state = NOT_FINITE;
  else if (rr <= RESIDUAL_FLOOR * lane->start)
    lane->state = CONVERGED;
  else if (rz <= 0)
    lane->state = INDEFINITE;
  else if (rz <= max(squared_tolerance * lane->scale, lane->absolute))
    lane->state = CONVERGED;
  return beta;
}

void finish(const Lane lane, global real* scalars, const int q, const int rhs) {
  scalars[DECREASE * rhs + q] = lane.decrease;
  scalars[WORK * rhs + q] = lane.work;
  scalars[RR * rhs + q] = lane.rr;
  scalars[ESTIMATE * rhs + q] = lane.estimate;
  scalars[SCALE * rhs + q] = lane.scale;
  scalars[STATE * rhs + q] = lane.state;
  scalars[ITERATIONS * rhs + q] = lane.iterations;
}

// Solves A x = r from x = 0; r: out, recursive residuals. Vectors [right-hand side][node][2].
kernel OF_GROUP void solve_whole(global const real* rows, global const real* inverses, global real* r_vectors,
                                 global const real* loads, global real* x_vectors, global vec* work,
                                 global real* scalars, const Shape shape, const int max_iterations,
                                 const real squared_tolerance) {
  SHARED;
  const int first = get_local_id(0), count = unknowns(shape), rhs = shape.rhs;
  global vec* x = work + (OWN_GROUP * PLANES + X) * count;
  global vec* r = x + R * count;
  global vec* p = x + P * count;
  global vec* z = x + Z * count;
  global vec* force = x + FORCE * count;
  vec rr = 0;
  for (int u = first; u < count; u += GROUP) {
    x[u] = 0;
    r[u] = packed(r_vectors, shape, u);
    force[u] = packed(loads, shape, u);
    rr += r[u] * r[u];
  }
  rr = total(rr, group);
  Lane lanes[WIDTH];
  real a[WIDTH], b[WIDTH];
  for (int k = 0; k < max_iterations; ++k) {
    const vec rz = precondition(rows, inverses, r, z, shape, group);
    STORE(rr, a);
    STORE(rz, b);
    bool running = false;
    for (int lane = 0; lane < WIDTH; ++lane) {
      const int q = OWN_GROUP * WIDTH + lane;
      if (k == 0) lanes[lane] = begin(scalars, q, rhs, b[lane], a[lane]);
      a[lane] = k == 0 ? 0 : judge(lanes + lane, a[lane], b[lane], squared_tolerance);
      running = running || lanes[lane].state == RUNNING;
      if (first == 0 && q < rhs && k > 0) scalars[BETA_OF(k - 1) * rhs + q] = a[lane];
    }
    if (!running) break;
    const vec beta = LOAD(a);
    for (int u = first; u < count; u += GROUP) p[u] = k == 0 ? z[u] : z[u] + beta * p[u];
    barrier(CLK_GLOBAL_MEM_FENCE);
    vec curvature = 0, done = 0;
    for (int u = first; u < count; u += GROUP) {
      z[u] = times_operator(rows, p, shape, u);
      curvature += p[u] * z[u];
      done += p[u] * force[u];
    }
    curvature = total(curvature, group);
    done = total(done, group);
    STORE(curvature, a);
    STORE(done, b);
    for (int lane = 0; lane < WIDTH; ++lane) {
      const int q = OWN_GROUP * WIDTH + lane;
      a[lane] = step_of(lanes + lane, a[lane], b[lane]);
      if (first != 0 || q >= rhs) continue;
      scalars[ALPHA_OF(k) * rhs + q] = a[lane];
      scalars[BETA_OF(k) * rhs + q] = 0;
    }
    const vec alpha = LOAD(a);
    rr = 0;
    for (int u = first; u < count; u += GROUP) {
      // One that has stopped keeps its values whatever p holds.
      r[u] = alpha != 0 ? r[u] - alpha * z[u] : r[u];
      x[u] = alpha != 0 ? x[u] + alpha * p[u] : x[u];
      rr += r[u] * r[u];
    }
    rr = total(rr, group);
  }
  STORE(rr, a);
  for (int lane = 0; lane < WIDTH; ++lane) end(lanes + lane, a[lane]);
  for (int u = first; u < count; u += GROUP) {
    unpack(x[u], x_vectors, shape, u);
    unpack(r[u], r_vectors, shape, u);
  }
  for (int lane = 0; lane < WIDTH && first == 0; ++lane)
    if (OWN_GROUP * WIDTH + lane < rhs) finish(lanes[lane], scalars, OWN_GROUP * WIDTH + lane, rhs);
}

// z = M r for vectors as above, products: r . z of each.
kernel OF_GROUP void apply_whole(global const real* rows, global const real* inverses,
                                 global const real* r_vectors, global real* z_vectors, global vec* work,
                                 global real* products, const Shape shape) {
  SHARED;
  const int first = get_local_id(0), count = unknowns(shape);
  global vec* r = work + (OWN_GROUP * PLANES + R) * count;
  global vec* z = work + (OWN_GROUP * PLANES + Z) * count;
  for (int u = first; u < count; u += GROUP) r[u] = packed(r_vectors, shape, u);
  real lanes[WIDTH];
  STORE(precondition(rows, inverses, r, z, shape, group), lanes);
  for (int u = first; u < count; u += GROUP) unpack(z[u], z_vectors, shape, u);
  for (int lane = 0; lane < WIDTH && first == 0; ++lane)
    if (OWN_GROUP * WIDTH + lane < shape.rhs) products[OWN_GROUP * WIDTH + lane] = lanes[lane];
}
