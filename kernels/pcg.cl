// Preconditioned conjugate gradients on many right-hand sides at once, every scalar on the device. Vectors:
// [right-hand side][node] of real2.
#include "pcg.clh"
#include "sums.clh"

// Nodes of chunk n, in turns over a work-group's items on a GPU: those next to each other load next to each
// other.
#if GROUP == 1
#define FIRST_OF(n) ((n)*chunk)
#define APART 1
#else
#define FIRST_OF(n) (n)
#define APART chunks
#endif
#define END_OF(n) (GROUP == 1 ? min(((n) + 1) * chunk, nodes) : nodes)

// Two inner products at once, a.b and c.d: each item sums one chunk of nodes. Items: (chunk, right-hand
// side). partial: [2][right-hand side][chunk]. Reads 8 reals and takes 8 flops per node.
kernel void dot_two(global const real2* restrict a, global const real2* restrict b,
                    global const real2* restrict c, global const real2* restrict d,
                    global accum* restrict partial, const int nodes, const int chunk, const int chunks,
                    const int rhs) {
  const int n = get_global_id(0), q = get_global_id(1);
  if (n >= chunks) return;
  real2 first = (real2)(0), second = (real2)(0);
  for (int m = q * nodes + FIRST_OF(n); m < q * nodes + END_OF(n); m += APART) {
    first += a[m] * b[m];
    second += c[m] * d[m];
  }
  partial[q * chunks + n] = first.x + first.y;
  partial[(rhs + q) * chunks + n] = second.x + second.y;
}

// rz, rr of the start; x = 0. Groups: right-hand sides, here and below; their first items write.
kernel OF_GROUP void pcg_begin(global const accum* restrict partial, global real* restrict scalars,
                               const int chunks, const int rhs) {
  local accum shared[GROUP];
  const int q = OWN_GROUP;
  const real rz = sum_of(partial + q * chunks, chunks, shared),
             rr = sum_of(partial + (rhs + q) * chunks, chunks, shared);
  if (get_local_id(0) != 0) return;
  scalars[RZ * rhs + q] = rz;
  scalars[RR * rhs + q] = rr;
  scalars[RR_START * rhs + q] = rr;
  scalars[BETA * rhs + q] = 0;
  scalars[DECREASE * rhs + q] = 0;
  scalars[WORK * rhs + q] = 0;
  scalars[ESTIMATE * rhs + q] = 0;
  scalars[SCALE * rhs + q] = scalars[INITIAL * rhs + q];
  scalars[STATE * rhs + q] = !isfinite(rz) || !isfinite(rr) ? NOT_FINITE
                             : rr == 0                      ? CONVERGED
                             : rz <= 0                      ? INDEFINITE
                                                            : RUNNING;
  scalars[ITERATIONS * rhs + q] = 0;
}

// alpha = r.z / p.Ap, after dot_two(p, Ap, p, load).
kernel OF_GROUP void pcg_alpha(global const accum* restrict partial, global real* restrict scalars,
                               const int iteration, const int chunks, const int rhs) {
  local accum shared[GROUP];
  const int q = OWN_GROUP;
  const real curvature = sum_of(partial + q * chunks, chunks, shared);
  const real work = sum_of(partial + (rhs + q) * chunks, chunks, shared);
  if (get_local_id(0) != 0) return;
  const real rz = scalars[RZ * rhs + q];
  global real* state = scalars + STATE * rhs + q;
  if (*state == RUNNING && !isfinite(curvature)) *state = NOT_FINITE;
  if (*state == RUNNING && curvature <= 0) *state = INDEFINITE;
  const bool running = *state == RUNNING;
  const real alpha = running ? rz / curvature : 0;
  const real term = alpha * rz;
  scalars[ALPHA * rhs + q] = alpha;
  scalars[DECREASE * rhs + q] += term;
  scalars[WORK * rhs + q] += running ? alpha * work : 0;
  scalars[TERM(iteration) * rhs + q] = term;
  scalars[ALPHA_OF(iteration) * rhs + q] = alpha;
  scalars[BETA_OF(iteration) * rhs + q] = 0;
  if (running) scalars[ITERATIONS * rhs + q] = iteration + 1;
}

// x += alpha p, r -= alpha Ap, and partial sums of r.r; a stopped right-hand side (alpha = 0) keeps its
// values whatever p holds. Items and partial as in dot_two. Reads 8 reals, writes 4 and takes 12 flops per
// node.
kernel void pcg_update(global const real* restrict scalars, global const real2* restrict p,
                       global const real2* restrict ap, global real2* restrict x, global real2* restrict r,
                       global accum* restrict partial, const int nodes, const int chunk, const int chunks,
                       const int rhs) {
  const int n = get_global_id(0), q = get_global_id(1);
  if (n >= chunks) return;
  const int begin = q * nodes + FIRST_OF(n), end = q * nodes + END_OF(n);
  const real alpha = scalars[ALPHA * rhs + q];
  real2 rr = (real2)(0);
  if (alpha == 0)
    for (int m = begin; m < end; m += APART) rr += r[m] * r[m];
  else
    for (int m = begin; m < end; m += APART) {
      const real2 left = r[m] - alpha * ap[m];
      x[m] += alpha * p[m];
      r[m] = left;
      rr += left * left;
    }
  partial[q * chunks + n] = rr.x + rr.y;
}

// Squared energy norm of the error after `iteration` (Hestenes-Stiefel; Strakos and Tichy 2002): the sum of
// the last `delay` terms is the error `delay` steps ago less the error now. Sums over three such windows say
// how fast it falls (the slower of two ratios), and from that how much is left now: the geometric rest, but
// never taken for less than the last sum. A slow run falls by fits and starts: the windows grow with it.
real error_estimate(global const real* restrict scalars, const int iteration, const int min_delay,
                    const int q, const int rhs) {
  const int delay = max(min_delay, (iteration + 1) / 8);
  real now = 0, before = 0, first = 0;
  for (int k = 0; k < delay; ++k) {
    now += scalars[TERM(iteration - k) * rhs + q];
    before += scalars[TERM(iteration - delay - k) * rhs + q];
    const int oldest = iteration - 2 * delay - k;
    first += oldest >= 0 ? scalars[TERM(oldest) * rhs + q] : 0;
  }
  const real ratio = min(max(now / before, first > 0 ? before / first : 0), REAL(0.99));
  return now * max(REAL(1.0), ratio / (1 - ratio));
}

// The decision to stop, after pcg_update: before the preconditioner is applied again.
kernel OF_GROUP void pcg_judge(global const accum* restrict partial, global real* restrict scalars,
                               const int iteration, const int delay, const real squared_tolerance,
                               const real squared_residual_tolerance, const int chunks, const int rhs) {
  local accum shared[GROUP];
  const int q = OWN_GROUP;
  const real rr = sum_of(partial + q * chunks, chunks, shared), start = scalars[RR_START * rhs + q];
  if (get_local_id(0) != 0 || scalars[STATE * rhs + q] != RUNNING) return;
  const real scale = scalars[INITIAL * rhs + q] + 2 * scalars[WORK * rhs + q] - scalars[DECREASE * rhs + q];
  // Solved to the last digit before there were enough terms to estimate from (tiny problems).
  const bool exhausted = rr <= RESIDUAL_FLOOR * start;
  const real estimate = rr == 0                      ? 0
                        : exhausted                  ? scalars[TERM(iteration) * rhs + q]
                        : iteration + 1 >= 2 * delay ? error_estimate(scalars, iteration, delay, q, rhs)
                                                     : INFINITY;
  scalars[RR * rhs + q] = rr;
  scalars[SCALE * rhs + q] = scale;
  scalars[ESTIMATE * rhs + q] = estimate;
  const bool small_error = estimate <= max(squared_tolerance * scale, scalars[ABSOLUTE * rhs + q]);
  const bool small_residual = rr <= squared_residual_tolerance * start;
  if (!isfinite(rr))
    scalars[STATE * rhs + q] = NOT_FINITE;
  else if (exhausted || small_error || small_residual)
    scalars[STATE * rhs + q] = CONVERGED;
}

// beta = (r.z)_new / (r.z)_old, after dot_two(r, z, r, r).
kernel OF_GROUP void pcg_beta(global const accum* restrict partial, global real* restrict scalars,
                              const int iteration, const int chunks, const int rhs) {
  local accum shared[GROUP];
  const int q = OWN_GROUP;
  const real rz = sum_of(partial + q * chunks, chunks, shared);
  if (get_local_id(0) != 0) return;
  const bool running = scalars[STATE * rhs + q] == RUNNING;
  const real beta = running ? rz / scalars[RZ * rhs + q] : 0;
  scalars[BETA_OF(iteration) * rhs + q] = beta;
  scalars[BETA * rhs + q] = beta;
  if (!running) return;
  scalars[RZ * rhs + q] = rz;
  if (!isfinite(rz))
    scalars[STATE * rhs + q] = NOT_FINITE;
  else if (rz <= 0)
    scalars[STATE * rhs + q] = INDEFINITE;
}

// p = z + beta p; beta = 0 at the start, where p holds nothing. Items: (node, right-hand side).
kernel void pcg_direction(global const real* restrict scalars, global const real2* restrict z,
                          global real2* restrict p, const int nodes, const int rhs) {
  const int n = get_global_id(0), q = get_global_id(1);
  if (n >= nodes) return;
  const real beta = scalars[BETA * rhs + q];
  const int at = q * nodes + n;
  p[at] = beta == 0 ? z[at] : z[at] + beta * p[at];
}
