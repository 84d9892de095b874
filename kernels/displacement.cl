// Displacement from a pair of RF frames (T2), post(x + u) = pre(x), from where search.cl found it on.
//
// Images and nodes as in frames.clh. Displacement fields are float2: x in A-lines (lateral), y in samples
// (axial). Vectors of 8 run along the axial axis; one work-item serves one node, so no barrier is needed.

#include "frames.clh"
#include "vectors.clh"

#ifndef WORK_GROUP  // work-items of a group, all kernels of this file
#define WORK_GROUP 32
#endif
#define WARP_RUN 16        // consecutive samples of one work-item of warp: a vector
#ifndef MEDIAN_RADIUS_MAX  // largest radius of median_filter, in nodes
#define MEDIAN_RADIUS_MAX 2
#endif
#define MEDIAN_VECTORS (((2 * MEDIAN_RADIUS_MAX + 1) * (2 * MEDIAN_RADIUS_MAX + 1) + 7) / 8)

// Bilinear value at (column, row) of a field on an nx x ny grid, held constant outside.
float2 field_at(__global const float2* restrict field, const int nx, const int ny, const float column,
                const float row) {
  const float c = clamp(column, 0.0f, (float)(nx - 1)), r = clamp(row, 0.0f, (float)(ny - 1));
  const int i = min((int)c, max(nx - 2, 0)), j = min((int)r, max(ny - 2, 0));
  const int right = nx > 1 ? 1 : 0, below = ny > 1 ? nx : 0;
  const float s = c - (float)i, t = r - (float)j;
  __global const float2* const p = field + i + nx * j;
  return (1.0f - t) * ((1.0f - s) * p[0] + s * p[right]) + t * ((1.0f - s) * p[below] + s * p[below + right]);
}

// Row of the interpolation table at `fraction` (0 .. 1), blended between its phases.
float8 taps_at(__global const float* restrict taps, const float fraction, const int phases) {
  const float t = fraction * (float)phases;
  const int phase = min((int)t, phases - 1);
  const float8 t0 = vload8(phase, taps), t1 = vload8(phase + 1, taps);
  return t0 + (t - (float)phase) * (t1 - t0);
}

// Four samples each from four places on.
float16 four_from(const float* strip, const int4 at) {
  return (float16)(LOAD4_PRIVATE(strip + at.x), LOAD4_PRIVATE(strip + at.y), LOAD4_PRIVATE(strip + at.z),
                   LOAD4_PRIVATE(strip + at.w));
}

// Sixteen samples of a line interpolated `distance` (at most INTERPOLATION_RANGE) beside the four from each
// of `at` on. Taps are Chebyshev series in t = distance / range, [order][n] for n = 0 .. 3: those of even
// orders are alike on both sides, those of odd ones opposite. The tap at distance 4, there on the side of t
// only, and the gain that makes the taps' sum one are series in 2 |t| - 1 (interpolation.h).
#define INTERPOLATION_RANGE 0.8f
float16 between_samples(const float* strip, const int4 at, const float16 distance,
                        __global const float* restrict series) {
  const float16 t = distance * (1.0f / INTERPOLATION_RANGE), own = four_from(strip, at);
  float16 even[4], odd[3];
#pragma unroll
  for (int k = 0; k < 4; ++k) even[k] = series[8 * k] * own;
#pragma unroll
  for (int k = 0; k < 3; ++k) odd[k] = (float16)(0.0f);
#pragma unroll
  for (int n = 1; n < 4; ++n) {
    const float16 before = four_from(strip - n, at), after = four_from(strip + n, at);
    const float16 sum = after + before, difference = after - before;
#pragma unroll
    for (int k = 0; k < 4; ++k) even[k] = fma((float16)(series[8 * k + n]), sum, even[k]);
#pragma unroll
    for (int k = 0; k < 3; ++k) odd[k] = fma((float16)(series[8 * k + 4 + n]), difference, odd[k]);
  }
  const float16 far = select(four_from(strip - 4, at), four_from(strip + 4, at), t > 0.0f);
  __global const float* const c = series + 28;
  const float16 s = 2.0f * fabs(t) - 1.0f, s2 = 2.0f * s * s - 1.0f, s3 = s * (2.0f * s2 - 1.0f);
  const float16 s4 = 2.0f * s2 * s2 - 1.0f;
  const float16 weight = c[0] + s * c[1] + s2 * c[2] + s3 * c[3] + s4 * c[4];
  const float16 gain = c[5] + s * c[6] + s2 * c[7] + s3 * c[8] + s4 * c[9];
  const float16 t2 = 2.0f * t * t - 1.0f, t3 = t * (2.0f * t2 - 1.0f), t4 = 2.0f * t2 * t2 - 1.0f;
  const float16 t5 = 2.0f * t * t4 - t3, t6 = 2.0f * t3 * t3 - 1.0f;
  return gain * (weight * far + even[0] + t * odd[0] + t2 * even[1] + t3 * odd[1] + t4 * even[2] +
                 t5 * odd[2] + t6 * even[3]);
}

// The whole number below and the nearest ones, give or take 1/500; |x| < 16384. Truncation alone is one
// instruction.
int below(const float x) {
  return (int)(x + 16384.0f) - 16384;
}
int4 nearest(const float4 x) {
  return convert_int4(x + 16384.5f) - 16384;
}

// Axial component of a field at `column` and the rows of sixteen consecutive samples, bilinear and held
// constant outside as field_at(); they may not span more than three rows of nodes.
float16 axial_along(__global const float2* restrict field, const int nx, const int ny, const float column,
                    const float16 rows) {
  const float c = clamp(column, 0.0f, (float)(nx - 1));
  const float16 r = clamp(rows, 0.0f, (float)(ny - 1));
  const int i = min((int)c, max(nx - 2, 0)), j = (int)r.s0, right = nx > 1 ? 1 : 0;
  const float s = c - (float)i;
  float u[4];
  for (int n = 0; n < 4; ++n) {
    __global const float2* const p = field + i + nx * min(j + n, ny - 1);
    u[n] = p[0].y + s * (p[right].y - p[0].y);
  }
  const float16 from_node = r - (float)j;
  return u[0] + from_node * (u[1] - u[0]) + fmax(from_node - 1.0f, 0.0f) * (u[2] - 2.0f * u[1] + u[0]) +
         fmax(from_node - 2.0f, 0.0f) * (u[3] - 2.0f * u[2] + u[1]);
}

// Companding and motion compensation: post(x + u(x)) on the samples of pre, u bilinear between the nodes,
// which are at least 8 samples apart; its lateral part is taken at the middle of each run of WARP_RUN
// samples. By a windowed sinc both ways: `taps` (`phases` + 1 rows of 8, row p for a fraction p / phases)
// across the lines, `series` along them. Writes either the warped frame (pair = 0), or the mean of pre and
// warped post to `a` and their difference pre - warped to `b`, both zero where x or x + u lies outside of its
// line's span of echoes (pair = 1); behind a line's end zeros. One item per run of a line: first the run's
// strip of post, interpolated laterally, then its samples; per sample 5 loads of a vector of 4, ~8 vector
// flops. |strain| <= 0.2 axially. Reads 3 lines before the frame and 4 behind it at most: of a line
// outside, whatever stands nearest, which is not used.
#define STRIP (WARP_RUN + 16)
__kernel __attribute__((reqd_work_group_size(16, 1, 1))) void warp(
    __global const float* restrict pre, __global const float* restrict post,
    __global const int2* restrict pre_spans, __global const int2* restrict post_spans,
    __global const float2* restrict field, __global const float* restrict taps,
    __global const float* restrict series, __global float* restrict a, __global float* restrict b,
    const int pair, const int phases, const int line_count, const int sample_count, const Nodes g,
    const Layout layout) {
  const int start = get_global_id(0) * WARP_RUN, l = get_global_id(1);
  if (start >= sample_count) return;
  const int nx = g.nx, ny = g.ny, first_sample = g.first_sample, stride = layout.stride;
  const float column = (float)(l - g.first_line) / (float)g.line_step,
              rows_per_sample = 1.0f / (float)g.sample_step;
  const float middle = (float)(start + WARP_RUN / 2 - first_sample) * rows_per_sample;
  const float2 shift = field_at(field, nx, ny, column, middle);
  const float x = (float)l + shift.x;
  const int line = below(x), first = start + below(shift.y) - 7;
  const bool inside = line >= 0 && line < line_count && first + STRIP > 0 && first < sample_count;
  const float2 own_span = convert_float2(pre_spans[l]),
               span = convert_float2(post_spans[clamp(line, 0, line_count - 1)]);
  float strip[STRIP];
  float16 sums[STRIP / 16];
  const float8 across = taps_at(taps, x - (float)line, phases);
  const float* const weights = (const float*)&across;
  __global const float* const p = post + layout.origin + clamp(line - 3, -3, line_count - 4) * stride +
                                  clamp(first, -STRIP, sample_count);
#pragma unroll
  for (int v = 0; v < STRIP / 16; ++v) sums[v] = across.s0 * vload16(v, p);
#pragma unroll
  for (int n = 1; n < 8; ++n)
#pragma unroll
    for (int v = 0; v < STRIP / 16; ++v)
      sums[v] = fma((float16)(weights[n]), vload16(v, p + n * stride), sums[v]);
#pragma unroll
  for (int v = 0; v < STRIP / 16; ++v) vstore16(sums[v], v, strip);
  const float16 samples = (float)start + (float16)(0.0f, 1.0f, 2.0f, 3.0f, 4.0f, 5.0f, 6.0f, 7.0f, 8.0f, 9.0f,
                                                   10.0f, 11.0f, 12.0f, 13.0f, 14.0f, 15.0f);
  const float16 u = axial_along(field, nx, ny, column, (samples - (float)first_sample) * rows_per_sample);
  const int4 whole = nearest(0.5f * (u.s048c + u.s37bf)), at = start - first + (int4)(0, 4, 8, 12) + whole;
  const float16 t = u - convert_float4(whole).s0000111122223333, there = samples + u;
  const int4 in_strip = inside ? (at >= 4) & (at <= STRIP - 8) : (int4)(0);
  const int16 seen = in_strip.s0000111122223333 & (there >= span.x) & (there < span.y) &
                     (samples >= own_span.x) & (samples < own_span.y) & (fabs(t) <= INTERPOLATION_RANGE);
  // Vectors as bounds: Oclgrind misreads others.
  const float16 value = select(
      (float16)(0.0f), between_samples(strip, clamp(at, (int4)(4), (int4)(STRIP - 8)), t, series), seen);
  const int to = layout.origin + l * stride + start;
  const float16 own = select((float16)(0.0f), vload16(0, pre + to), seen);
  vstore16(pair ? 0.5f * (own + value) : value, 0, a + to);
  if (pair) vstore16(own - value, 0, b + to);
}

// Median of `count` > 0 values in the first slots of v, the rest +inf. By rank: v_k is the t-th smallest when
// #{v < v_k} <= t < #{v <= v_k}; no sorting, no branches, 8 comparisons at a time.
float median_of(const float8* v, const int count) {
  const float* const values = (const float*)v;
  const int lower = (count - 1) / 2, upper = count / 2;
  float sum = 0.0f;
  int found_lower = 0, found_upper = 0;
  for (int k = 0; k < count; ++k) {
    const float8 own = (float8)(values[k]);
    int8 less = 0, up_to = 0;  // a true comparison is -1
    for (int n = 0; n < MEDIAN_VECTORS; ++n) {
      less -= v[n] < own;
      up_to -= v[n] <= own;
    }
    const int4 l = less.lo + less.hi, q = up_to.lo + up_to.hi;
    const int below = l.x + l.y + l.z + l.w, reached = q.x + q.y + q.z + q.w;
    const int is_lower = !found_lower && below <= lower && lower < reached;
    const int is_upper = !found_upper && below <= upper && upper < reached;
    sum += (float)(is_lower + is_upper) * values[k];
    found_lower |= is_lower;
    found_upper |= is_upper;
  }
  return 0.5f * sum;
}

// Whether both middle values of the `count` > 0 first ones in v, the rest +inf, are within `tolerance` of
// `own`, and so the median: then no more than half of them lie below own - tolerance, nor above own +
// tolerance.
bool near_median(const float8* v, const int count, const float own, const float tolerance) {
  const float8 least = (float8)(own - tolerance), most = (float8)(own + tolerance);
  int8 below = 0, up_to = 0;  // a true comparison is -1
  for (int n = 0; n < MEDIAN_VECTORS; ++n) {
    below -= v[n] < least;
    up_to -= v[n] <= most;
  }
  const int4 b = below.lo + below.hi, q = up_to.lo + up_to.hi;
  return b.x + b.y + b.z + b.w <= (count - 1) / 2 && count / 2 < q.x + q.y + q.z + q.w;
}

// Cures peak hops between levels. Looks at the correction field - prediction, which is free of the strain's
// gradient: where it is further than the tolerance (lines, samples) from the median over the trusted
// neighbours (correlation >= threshold, radius in nodes), or the node itself is not trusted, the median takes
// its place. deviation = axial distance from the median, 0 where both components of a trusted node are within
// their tolerance. Without trusted neighbours the prediction stands, deviation = inf.
__kernel __attribute__((reqd_work_group_size(WORK_GROUP, 1, 1))) void median_filter(
    __global const float2* restrict field, __global const float2* restrict prediction,
    __global const float* restrict correlation, __global float2* restrict out,
    __global float* restrict deviation, const int nx, const int ny, const int radius, const float threshold,
    const float lateral_tolerance, const float axial_tolerance) {
  const int node = get_global_id(0);
  if (node >= nx * ny) return;
  const int i = node % nx, j = node / nx;
  float8 x[MEDIAN_VECTORS], y[MEDIAN_VECTORS];
  for (int n = 0; n < MEDIAN_VECTORS; ++n) x[n] = y[n] = (float8)(INFINITY);
  float* const xs = (float*)x;
  float* const ys = (float*)y;
  int count = 0;
  for (int n = max(j - radius, 0); n <= min(j + radius, ny - 1); ++n)
    for (int m = max(i - radius, 0); m <= min(i + radius, nx - 1); ++m) {
      if (!(correlation[m + nx * n] >= threshold)) continue;
      const float2 v = field[m + nx * n] - prediction[m + nx * n];
      xs[count] = v.x;
      ys[count] = v.y;
      ++count;
    }
  if (count < 3) {
    out[node] = prediction[node];
    deviation[node] = INFINITY;
    return;
  }
  const float2 own = field[node] - prediction[node];
  const bool trusted = correlation[node] >= threshold;
  if (trusted && near_median(x, count, own.x, lateral_tolerance) &&
      near_median(y, count, own.y, axial_tolerance)) {
    out[node] = field[node];
    deviation[node] = 0.0f;
    return;
  }
  const float2 median = (float2)(median_of(x, count), median_of(y, count)), off = fabs(own - median);
  out[node] = prediction[node] + (float2)(trusted && off.x <= lateral_tolerance ? own.x : median.x,
                                          trusted && off.y <= axial_tolerance ? own.y : median.y);
  deviation[node] = trusted && off.x <= lateral_tolerance && off.y <= axial_tolerance ? 0.0f : off.y;
}

// Binomial 3 x 3 smoothing: the field that the next warp uses. At the border only pairs of opposite
// neighbours that both exist take part, so that uniform strain passes unchanged.
__kernel __attribute__((reqd_work_group_size(WORK_GROUP, 1, 1))) void smooth(
    __global const float2* restrict field, __global float2* restrict out, const int nx, const int ny) {
  const int node = get_global_id(0);
  if (node >= nx * ny) return;
  const int i = node % nx, j = node / nx;
  const int columns = min(min(i, nx - 1 - i), 1), rows = min(min(j, ny - 1 - j), 1);
  const float2 own = field[node];
  float2 sum = own;
  for (int n = -rows; n <= rows; ++n)
    for (int m = -columns; m <= columns; ++m)
      sum += (float)((2 - abs(m)) * (2 - abs(n))) / 16.0f * (field[node + m + nx * n] - own);
  out[node] = sum;
}

// A field from one sample grid onto another (bilinear, held constant outside).
__kernel __attribute__((reqd_work_group_size(WORK_GROUP, 1, 1))) void resample(
    __global const float2* restrict from, __global float2* restrict to, const Nodes old, const Nodes g) {
  const int node = get_global_id(0);
  if (node >= g.nx * g.ny) return;
  to[node] = field_at(from, old.nx, old.ny, (float)(line_of(g, node) - old.first_line) / (float)old.line_step,
                      (float)(sample_of(g, node) - old.first_sample) / (float)old.sample_step);
}

// What the image grid reports: displacement in metres and whether it can be trusted: correlation and
// deviation from the median (samples) within their limits, inside of its line's span before and after the
// motion.
__kernel __attribute__((reqd_work_group_size(WORK_GROUP, 1, 1))) void report(
    __global const float2* restrict field, __global const float* restrict correlation,
    __global const float* restrict deviation, __global const int2* restrict pre_spans,
    __global const int2* restrict post_spans, __global float2* restrict field_m,
    __global uchar* restrict trusted, const Nodes g, const int line_count, const float line_pitch_m,
    const float sample_pitch_m, const float threshold, const float axial_tolerance) {
  const int node = get_global_id(0);
  if (node >= g.nx * g.ny) return;
  const int line = line_of(g, node), sample = sample_of(g, node);
  const float2 at = (float2)((float)line, (float)sample) + field[node];
  const int2 before = pre_spans[line];
  const float2 after = convert_float2(post_spans[clamp((int)rint(at.x), 0, line_count - 1)]);
  const bool inside = sample >= before.x && sample < before.y && at.x >= -0.5f &&
                      at.x < (float)line_count - 0.5f && at.y >= after.x && at.y < after.y;
  field_m[node] = field[node] * (float2)(line_pitch_m, sample_pitch_m);
  trusted[node] = correlation[node] >= threshold && deviation[node] <= axial_tolerance && inside ? 1 : 0;
}
