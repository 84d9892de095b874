// Conjugate gradients for one system of a 2 x 2 block per node and its eight neighbours' (stencil.clh),
// preconditioned with the nodes' own blocks, which are definite: two launches an iteration, no scalar that a
// launch of its own would find (service/imaging/tracking/node_gradients.h). Each work-group takes a chunk of
// nodes and adds up what all left.
#include "stencil.clh"
#include "sums.clh"

// Numbers of `marks`, as in node_gradients.cpp: of this iteration and of the last in turns, and of all.
#define RZ(turn) (turn)             // r . z
#define GOES_ON(turn) (2 + (turn))  // a state (service/solver/pcg.h), before the step
#define STEPPED(turn) (4 + (turn))  // and after it
#define ITERATIONS 6
#define RR 7  // r . r, and at the start
#define RR_START 8
#define PARTS 9  // partial sums of r . z, then of r . r

#define RUNNING 0
#define CONVERGED 1
#define INDEFINITE 3
#define NOT_FINITE 4

// z = D^-1 r of a node, D its own block.
real2 own_solution(global const real4* restrict stencil, const real2 r, const int node, const int nodes) {
  const real4 d = stencil[4 * nodes + node];
  return (real2)(d.w * r.x - d.y * r.y, d.x * r.y - d.z * r.x) / (d.x * d.w - d.y * d.z);
}

// The start, x = 0 (start), or a step: x += alpha p, r -= alpha A p, alpha = r . z / p . A p. Then z = D^-1 r
// and parts of r . z and r . r. Groups: chunks of nodes.
kernel OF_GROUP void node_step(global const real4* restrict stencil, global const real2* restrict p,
                               global const real2* restrict ap, global real2* restrict x,
                               global real2* restrict r, global real2* restrict z,
                               global const accum* restrict curvature, global real* restrict marks,
                               const int nodes, const int chunk, const int parts, const int turn,
                               const int iteration, const int start) {
  local accum shared[GROUP];
  const bool first = get_global_id(0) == 0;
  real alpha = 0;
  if (!start) {
    const real state = marks[GOES_ON(turn)], sum = sum_of(curvature, parts, shared);
    const real after = state != RUNNING ? state
                       : !isfinite(sum) ? NOT_FINITE
                       : sum <= 0       ? INDEFINITE
                                        : RUNNING;
    if (first) marks[STEPPED(turn)] = after;
    if (after != RUNNING) return;
    if (first) marks[ITERATIONS] = iteration + 1;
    alpha = marks[RZ(turn)] / sum;
  }
  const int begin = OWN_GROUP * chunk, end = min(begin + chunk, nodes);
  real rz = 0, rr = 0;
  for (int n = begin + (int)get_local_id(0); n < end; n += GROUP) {
    real2 left = r[n];
    if (start) {
      x[n] = (real2)(0);
    } else {
      x[n] += alpha * p[n];
      left -= alpha * ap[n];
      r[n] = left;
    }
    const real2 own = own_solution(stencil, left, n, nodes);
    z[n] = own;
    rz += left.x * own.x + left.y * own.y;
    rr += left.x * left.x + left.y * left.y;
  }
  rz = sum_of_group(rz, shared);
  rr = sum_of_group(rr, shared);
  if (get_local_id(0) != 0) return;
  marks[PARTS + OWN_GROUP] = rz;
  marks[PARTS + parts + OWN_GROUP] = rr;
}

// The decision to go on, then p = z + beta p_from at each node and those around it, A p, and parts of p . A
// p.
kernel OF_GROUP void node_turn(global const real4* restrict stencil, global const real2* restrict z,
                               global const real2* restrict p_from, global real2* restrict p,
                               global real2* restrict ap, global accum* restrict curvature,
                               global real* restrict marks, const real squared_tolerance, const int nx,
                               const int ny, const int chunk, const int parts, const int turn,
                               const int start) {
  local accum shared[GROUP];
  const bool first = get_global_id(0) == 0;
  const real rz = sum_of(marks + PARTS, parts, shared), rr = sum_of(marks + PARTS + parts, parts, shared);
  const real before = start ? RUNNING : marks[STEPPED(1 - turn)], rr_start = start ? rr : marks[RR_START];
  const real state = before != RUNNING                                           ? before
                     : !isfinite(rz) || !isfinite(rr)                            ? NOT_FINITE
                     : rr == 0 || (!start && rr <= squared_tolerance * rr_start) ? CONVERGED
                     : rz <= 0                                                   ? INDEFINITE
                                                                                 : RUNNING;
  if (first) {
    marks[RZ(turn)] = rz;
    marks[GOES_ON(turn)] = state;
    marks[RR] = rr;
    if (start) marks[RR_START] = rr, marks[ITERATIONS] = 0;
  }
  if (state != RUNNING) return;
  const real beta = start ? 0 : rz / marks[RZ(1 - turn)];
  const int nodes = nx * ny, begin = OWN_GROUP * chunk, end = min(begin + chunk, nodes);
  real sum = 0;
  for (int n = begin + (int)get_local_id(0); n < end; n += GROUP) {
    const int i = n % nx, j = n / nx;
    real4 product = (real4)(0);
    real2 own = (real2)(0);
#pragma unroll
    for (int k = 0; k < 9; ++k) {  // neighbours that are not there: zero blocks, the node's own numbers
      const int di = k % 3 - 1, dj = k / 3 - 1;
      const int at = n + (i + di < 0 || i + di >= nx ? 0 : di) + (j + dj < 0 || j + dj >= ny ? 0 : dj * nx);
      real2 there = z[at];
      if (!start) there += beta * p_from[at];
      product += stencil[k * nodes + n] * there.xyxy;
      if (k == 4) own = there;
    }
    const real2 force = (real2)(product.x + product.y, product.z + product.w);
    p[n] = own;
    ap[n] = force;
    sum += own.x * force.x + own.y * force.y;
  }
  sum = sum_of_group(sum, shared);
  if (get_local_id(0) == 0) curvature[OWN_GROUP] = sum;
}
