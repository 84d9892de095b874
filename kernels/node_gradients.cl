// Conjugate gradients for one system of a 2 x 2 block per node and constant weights to the four nodes beside
// it, preconditioned with the nodes' own blocks, which are definite: a whole solve in a launch of one
// work-group (service/imaging/tracking/node_gradients.h). On a processor it is one item, WIDTH numbers at a
// time.
//
// Node (i, j) lies at i + stride (j + 1), stride = nx + 1: behind each row and above and below the grid nodes
// stand that are none. All that is theirs is and stays zero, so that no item asks where the grid ends. Two
// numbers a node, lateral and axial.
#ifndef WIDTH  // one node on a GPU
#define WIDTH 2
#endif
#include "sums.clh"

// Of each node the two numbers in turn.
#if WIDTH == 2
#define SWAP(v) (v).s10
#elif WIDTH == 4
#define SWAP(v) (v).s1032
#elif WIDTH == 8
#define SWAP(v) (v).s10325476
#else
#define SWAP(v) (v).s1032547698badcfe
#endif

// Numbers that say how a solve ended, as in node_gradients.cpp.
#define STATE 0
#define ITERATIONS 1
#define RR 2  // r . r, and at the start
#define RR_START 3
#define RZ 4  // r . z
#define BETA 5

#define RUNNING 0
#define CONVERGED 1
#define INDEFINITE 3
#define NOT_FINITE 4

vec of_nodes(const vec value, const vec diagonal) {
  return select((vec)(0), value, diagonal != 0);
}

// z = D^-1 r, D the nodes' own blocks.
vec own_solution(const vec diagonal, const vec cross, const vec r) {
  const vec across = SWAP(diagonal);
  return of_nodes((across * r - cross * SWAP(r)) / (diagonal * across - cross * cross), diagonal);
}

real judged(const real rz, const real rr, const real enough) {
  return !isfinite(rz) || !isfinite(rr) ? NOT_FINITE
         : rr == 0 || rr <= enough      ? CONVERGED
         : rz <= 0                      ? INDEFINITE
                                        : RUNNING;
}

// Iterations first .. last - 1 from where the last launch ended; first = 0: from x = 0.
// diagonal, cross: of the own blocks, cross twice. weights: along i, along j, lateral and axial each. r, x,
// z, p, ap: the residual, the solution, D^-1 r, the direction, A p. `count` vectors from the first node on.
// ends: of which the numbers from `at` on are this solve's.
kernel OF_GROUP void node_gradients(global const real* restrict diagonal, global const real* restrict cross,
                                    global const real2* weights, global real* restrict r,
                                    global real* restrict x, global real* restrict z, global real* restrict p,
                                    global real* restrict ap, global real* ends, const int at,
                                    const real squared_tolerance, const int stride, const int count,
                                    const int first, const int last) {
  local accum shared[GROUP];
  real lanes[2][WIDTH];
  for (int n = 0; n < WIDTH; ++n) {
    lanes[0][n] = n % 2 ? weights[0].y : weights[0].x;
    lanes[1][n] = n % 2 ? weights[1].y : weights[1].x;
  }
  const vec along = LOAD(lanes[0]), down = LOAD(lanes[1]);
  global real* const end = ends + at;
  const int begin = 2 * stride, row = 2 * stride, item = get_local_id(0);
  real state = RUNNING, rz = 0, rr = 0, rr_start = 0, beta = 0, iterations = 0;
  if (first == 0) {
    vec sum_z = (vec)(0), sum_r = (vec)(0);
    for (int v = item; v < count; v += GROUP) {
      const int n = begin + WIDTH * v;
      const vec left = LOAD(r + n), own = own_solution(LOAD(diagonal + n), LOAD(cross + n), left);
      STORE((vec)(0), x + n);
      STORE((vec)(0), p + n);
      STORE(own, z + n);
      sum_z += left * own;
      sum_r += left * left;
    }
    rz = sum_of_group(sum_lanes(sum_z), shared);
    rr = rr_start = sum_of_group(sum_lanes(sum_r), shared);
    state = judged(rz, rr, 0);
  } else {
    state = end[STATE], iterations = end[ITERATIONS], rr = end[RR], rr_start = end[RR_START];
    rz = end[RZ], beta = end[BETA];
  }
  for (int k = first; k < last && state == RUNNING; ++k) {
    for (int v = item; v < count; v += GROUP) {
      const int n = begin + WIDTH * v;
      STORE(LOAD(z + n) + beta * LOAD(p + n), p + n);
    }
    barrier(CLK_GLOBAL_MEM_FENCE);
    vec curvature = (vec)(0);
    for (int v = item; v < count; v += GROUP) {
      const int n = begin + WIDTH * v;
      const vec own = LOAD(p + n), d = LOAD(diagonal + n);
      const vec beside =
          along * (LOAD(p + n - 2) + LOAD(p + n + 2)) + down * (LOAD(p + n - row) + LOAD(p + n + row));
      const vec force = of_nodes(d * own + LOAD(cross + n) * SWAP(own) - beside, d);
      STORE(force, ap + n);
      curvature += own * force;
    }
    const real sum = sum_of_group(sum_lanes(curvature), shared);
    state = !isfinite(sum) ? NOT_FINITE : sum <= 0 ? INDEFINITE : RUNNING;
    if (state != RUNNING) break;
    const real alpha = rz / sum;
    vec sum_z = (vec)(0), sum_r = (vec)(0);
    for (int v = item; v < count; v += GROUP) {
      const int n = begin + WIDTH * v;
      STORE(LOAD(x + n) + alpha * LOAD(p + n), x + n);
      const vec left = LOAD(r + n) - alpha * LOAD(ap + n);
      const vec own = own_solution(LOAD(diagonal + n), LOAD(cross + n), left);
      STORE(left, r + n);
      STORE(own, z + n);
      sum_z += left * own;
      sum_r += left * left;
    }
    const real before = rz;
    rz = sum_of_group(sum_lanes(sum_z), shared);
    rr = sum_of_group(sum_lanes(sum_r), shared);
    barrier(CLK_GLOBAL_MEM_FENCE);  // the neighbours' p was read
    beta = rz / before;
    iterations = k + 1;
    state = judged(rz, rr, squared_tolerance * rr_start);
  }
  if (item != 0) return;
  end[STATE] = state, end[ITERATIONS] = iterations, end[RR] = rr, end[RR_START] = rr_start;
  end[RZ] = rz, end[BETA] = beta;
}
