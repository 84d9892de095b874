// Regularised refinement of a displacement field (T2.3) and what it needs to know of the noise.
//
// Images and nodes as in frames.clh. Fields: float2 per node, x in A-lines (lateral), y in samples (axial).

#include "deviation.clh"
#include "frames.clh"
#include "robust.clh"
#include "vectors.clh"

#ifndef WORK_GROUP
#define WORK_GROUP 32
#endif
#ifndef LAG_VECTORS  // autocorrelation(): axial lags 0 .. 16 LAG_VECTORS - 1
#define LAG_VECTORS 2
#endif

// Autocorrelations of `mean` and `difference` at axial lags 0 .. 16 LAG_VECTORS - 1 and lateral lag q, summed
// over `run` samples of every line_step-th line. Items: (line n, q, run r). out[(((r lines + n) laterals + q)
// 2 + image) 16 LAG_VECTORS + lag]. Per sample and item: 2 LAG_VECTORS vector loads, 64 LAG_VECTORS flops.
__kernel __attribute__((reqd_work_group_size(1, 1, 1))) void autocorrelation(
    __global const float* restrict mean, __global const float* restrict difference,
    __global float* restrict out, const int line_step, const int lines, const int laterals,
    const int sample_count, const int run, const Layout layout) {
  const int n = get_global_id(0), q = get_global_id(1), first = run * get_global_id(2),
            stride = layout.stride;
  __global const float* const m = mean + layout.origin + n * line_step * stride;
  __global const float* const d = difference + (m - mean);
  float16 mm[LAG_VECTORS], dd[LAG_VECTORS];
  for (int v = 0; v < LAG_VECTORS; ++v) mm[v] = dd[v] = (float16)(0.0f);
  for (int k = first; k < min(first + run, sample_count); ++k)
    for (int v = 0; v < LAG_VECTORS; ++v) {
      mm[v] = fma((float16)(m[k]), vload16(v, m + q * stride + k), mm[v]);
      dd[v] = fma((float16)(d[k]), vload16(v, d + q * stride + k), dd[v]);
    }
  __global float* const to = out + ((get_global_id(2) * lines + n) * laterals + q) * 32 * LAG_VECTORS;
  for (int v = 0; v < LAG_VECTORS; ++v) {
    vstore16(mm[v], v, to);
    vstore16(dd[v], LAG_VECTORS + v, to);
  }
}

// Symmetric filter: out(k) = taps[0] in(k) + sum_n taps[n] (in(k - n step) + in(k + n step)), n <= reach;
// step 1: along the A-lines, `stride`: across them. Of two images. Items: (16 samples, line, image).
__kernel __attribute__((reqd_work_group_size(16, 1, 1))) void filter_lines(
    __global const float* restrict pre, __global const float* restrict post, __global float* restrict pre_out,
    __global float* restrict post_out, __global const float* restrict taps, const int reach, const int step,
    const int sample_count, const Layout layout) {
  const bool second = get_global_id(2) != 0;
  __global const float* const in = second ? post : pre;
  __global float* const out = second ? post_out : pre_out;
  const int k = 16 * get_global_id(0), l = get_global_id(1);
  if (k >= sample_count) return;
  __global const float* const p = in + layout.origin + l * layout.stride + k;
  float16 sum = taps[0] * vload16(0, p);
  for (int n = 1; n <= reach; ++n)
    sum = fma((float16)(taps[n]), vload16(0, p - n * step) + vload16(0, p + n * step), sum);
  __global float* const to = out + layout.origin + l * layout.stride + k;
  if (k + 16 <= sample_count) {
    vstore16(sum, 0, to);
  } else {  // what lies behind the line's end stays zero
    const float* const last = (const float*)&sum;
    for (int n = 0; n < sample_count - k; ++n) to[n] = last[n];
  }
}

// What a node's own pixels say about a correction du of its displacement. Pixels are shared between the nodes
// by hat functions (axial weights `hat`, 8 chunks samples around the node; lateral 1 - |l| / line_step), so
// that all nodes together use each pixel once: the sums are a likelihood. Robust: a pixel whose difference is
// far beyond its node's noise weighs w = 1 / (1 + difference^2 / (CAUCHY^2 noise)) (IRLS; noise = 0: w = 1).
// terms[node] = sum w hat (gx gx, gx gy, gy gy, gx d, gy d, mean^2, mean d, d^2), d the difference, g the
// gradient of the mean: 7-point axially, 5-point laterally and none on the frame's two outermost lines.
// pixels[node] = sum w hat over pixels that say anything. Per 8 pixels: 11 vector loads, ~300 flops.
__kernel __attribute__((reqd_work_group_size(WORK_GROUP, 1, 1))) void data_term(
    __global const float* restrict mean, __global const float* restrict difference,
    __global const float* restrict hat, __global const float* restrict noise, __global float8* restrict terms,
    __global float* restrict pixels, const Nodes g, const Layout layout, const int line_count,
    const int chunks) {
  const int node = get_global_id(0);
  if (node >= g.nx * g.ny) return;
  const int line = line_of(g, node), line_step = g.line_step, stride = layout.stride;
  const int start = layout.origin + sample_of(g, node) - 4 * chunks;
  const float doubt = robust_doubt(noise[node]);
  float8 xx = 0.0f, xy = 0.0f, yy = 0.0f, xd = 0.0f, yd = 0.0f, mm = 0.0f, md = 0.0f, dd = 0.0f, ww = 0.0f;
  for (int l = max(line - line_step + 1, 0); l <= min(line + line_step - 1, line_count - 1); ++l) {
    const float across = 1.0f - (float)abs(l - line) / (float)line_step;
    const float inside = l > 1 && l < line_count - 2 ? 1.0f : 0.0f;
    __global const float* const s = mean + start + l * stride;
    __global const float* const d = difference + start + l * stride;
    for (int c = 0; c < 8 * chunks; c += 8) {
      const float8 m = LOAD8(s + c), e = LOAD8(d + c);
      const float8 w = across * LOAD8(hat + c) / (1.0f + doubt * e * e);
      const float8 gy = 0.75f * (LOAD8(s + c + 1) - LOAD8(s + c - 1)) -
                        0.15f * (LOAD8(s + c + 2) - LOAD8(s + c - 2)) +
                        (1.0f / 60.0f) * (LOAD8(s + c + 3) - LOAD8(s + c - 3));
      const float8 gx = inside * ((2.0f / 3.0f) * (LOAD8(s + c + stride) - LOAD8(s + c - stride)) -
                                  (1.0f / 12.0f) * (LOAD8(s + c + 2 * stride) - LOAD8(s + c - 2 * stride)));
      const float8 wgy = w * gy, wgx = w * gx, wm = w * m, we = w * e;
      xx = fma(wgx, gx, xx);
      xy = fma(wgx, gy, xy);
      yy = fma(wgy, gy, yy);
      xd = fma(wgx, e, xd);
      yd = fma(wgy, e, yd);
      mm = fma(wm, m, mm);
      md = fma(wm, e, md);
      dd = fma(we, e, dd);
      ww += select((float8)(0.0f), w, isnotequal(m, (float8)(0.0f)));
    }
  }
  terms[node] = (float8)(sum8(xx), sum8(xy), sum8(yy), sum8(xd), sum8(yd), sum8(mm), sum8(md), sum8(dd));
  pixels[node] = sum8(ww);
}

// Sums of terms over (2 radius + 1)^2 nodes: correlation of pre and warped post (-2 where nothing is heard)
// and noise, the mean squared difference per pixel. information: of the node's own pixels on its
// displacement, 1 / variance, (lateral, axial): sensitivity^2 gg / (spread noise). model[2], model[3]: spread
// and sensitivity (noise_model.h), lateral and axial.
__kernel __attribute__((reqd_work_group_size(WORK_GROUP, 1, 1))) void local_noise(
    __global const float8* restrict terms, __global const float* restrict pixels,
    __global const float2* restrict model, __global float* restrict correlation,
    __global float* restrict noise, __global float2* restrict information, const int nx, const int ny,
    const int radius) {
  const int node = get_global_id(0);
  if (node >= nx * ny) return;
  const int i = node % nx, j = node / nx;
  float mm = 0.0f, md = 0.0f, dd = 0.0f, ww = 0.0f;
  for (int n = max(j - radius, 0); n <= min(j + radius, ny - 1); ++n)
    for (int m = max(i - radius, 0); m <= min(i + radius, nx - 1); ++m) {
      const float8 t = terms[m + nx * n];
      mm += t.s5;
      md += t.s6;
      dd += t.s7;
      ww += pixels[m + nx * n];
    }
  const float energy = (mm + 0.25f * dd + md) * (mm + 0.25f * dd - md);
  // A node that hears next to nothing itself says nothing, whatever its neighbours hear.
  const bool textured = ww > 0.0f && energy > 1e-30f && terms[node].s5 > 1e-4f * mm;
  const float floor = 1e-8f * mm;  // of the noise, so that identical frames have finite information
  correlation[node] = textured ? (mm - 0.25f * dd) * rsqrt(energy) : -2.0f;
  noise[node] = textured ? (dd + floor) / ww : 0.0f;
  information[node] =
      textured ? model[3] * model[3] * (float2)(terms[node].s0, terms[node].s2) / (model[2] * noise[node])
               : (float2)(0.0f);
}

// Gradient of a field around each node, in field units per node step: (d/di of x, of y, d/dj of x, of y), the
// mean over (2 radius_i + 1) x (2 radius_j + 1) nodes cut at the border. Exact for uniform strain everywhere.
// strain: the magnitude of d/dj of y.
__kernel __attribute__((reqd_work_group_size(WORK_GROUP, 1, 1))) void local_gradient(
    __global const float2* restrict field, __global float4* restrict gradient,
    __global float* restrict strain, const int nx, const int ny, const int radius_i, const int radius_j) {
  const int node = get_global_id(0);
  if (node >= nx * ny) return;
  const int i = node % nx, j = node / nx;
  const int left = max(i - radius_i, 0), right = min(i + radius_i, nx - 1);
  const int upper = max(j - radius_j, 0), lower = min(j + radius_j, ny - 1);
  float2 along = 0.0f, down = 0.0f;  // sums of differences between neighbours telescope
  for (int n = upper; n <= lower; ++n) along += field[right + nx * n] - field[left + nx * n];
  for (int m = left; m <= right; ++m) down += field[m + nx * lower] - field[m + nx * upper];
  down /= (float)(max(lower - upper, 1) * (right - left + 1));
  gradient[node] = (float4)(along / (float)(max(right - left, 1) * (lower - upper + 1)), down);
  strain[node] = fabs(down.y);
}

// The system of one Gauss-Newton step: minimises over the correction v of `field` u
//   sum over nodes  v.h v - 2 v.b  +  sum over edges  weight (difference of u + v  -  mean gradient)^2,
// h the information of local_noise(), b = sensitivity gd / (spread noise). model: weight of edges along i, of
// edges along j, spread and sensitivity, each lateral and axial. Writes the nodes' own blocks and the
// right-hand side as node_gradients.cl has them, `stride` nodes from row to row.
__kernel __attribute__((reqd_work_group_size(WORK_GROUP, 1, 1))) void assemble(
    __global const float8* restrict terms, __global const float* restrict noise,
    __global const float2* restrict information, __global const float2* restrict field,
    __global const float4* restrict gradient, __global const float2* restrict model,
    __global float2* restrict diagonal, __global float2* restrict cross, __global float2* restrict rhs,
    const int nx, const int ny, const int stride) {
  const int node = get_global_id(0);
  if (node >= nx * ny) return;
  const int i = node % nx, j = node / nx;
  const float2 weight_along = model[0], weight_down = model[1], sensitivity = model[3];
  const float8 t = terms[node];
  const float2 gain = noise[node] > 0.0f ? sensitivity / (model[2] * noise[node]) : (float2)(0.0f);
  float2 sum = gain * (float2)(t.s3, t.s4);
  float2 centre = information[node] + 1e-6f * (weight_along + weight_down);  // definite without any echo too
  const float2 own = field[node];
  const float4 slope = gradient[node];
  for (int k = 1; k < 9; k += 2) {
    const int di = k % 3 - 1, dj = k / 3 - 1, to = node + di + nx * dj;
    if (i + di < 0 || i + di >= nx || j + dj < 0 || j + dj >= ny) continue;
    const float4 mean = 0.5f * (slope + gradient[to]);
    const float2 weight = dj == 0 ? weight_along : weight_down,
                 expected = dj == 0 ? (float)di * mean.lo : (float)dj * mean.hi;
    centre += weight;
    sum += weight * (field[to] - own - expected);
  }
  const int at = i + stride * (j + 1);
  diagonal[at] = centre;
  cross[at] = sqrt(gain.x * gain.y * sensitivity.x * sensitivity.y) * t.s1;
  rhs[at] = sum;
}

// field + correction, limited to (lateral, axial); the correction as node_gradients.cl has it.
__kernel __attribute__((reqd_work_group_size(WORK_GROUP, 1, 1))) void correct(
    __global const float2* restrict field, __global const float2* restrict correction,
    __global float2* restrict out, const int nx, const int ny, const int stride, const float lateral_limit,
    const float axial_limit) {
  const int node = get_global_id(0);
  if (node >= nx * ny) return;
  const float2 limit = (float2)(lateral_limit, axial_limit);
  out[node] = field[node] + clamp(correction[node % nx + stride * (node / nx + 1)], -limit, limit);
}

// How the edges pull each node of the final `field` away from where its pixels want it, information x
// displacement: the gradient of the edges' part of assemble()'s functional.
__kernel __attribute__((reqd_work_group_size(WORK_GROUP, 1, 1))) void edge_pull(
    __global const float2* restrict field, __global const float4* restrict gradient,
    __global const float2* restrict model, __global float2* restrict pull, const int nx, const int ny) {
  const int node = get_global_id(0);
  if (node >= nx * ny) return;
  const int i = node % nx, j = node / nx;
  const float2 own = field[node];
  const float4 slope = gradient[node];
  float2 sum = 0.0f;
  if (i > 0) sum += model[0] * (field[node - 1] - own + 0.5f * (slope.lo + gradient[node - 1].lo));
  if (i + 1 < nx) sum += model[0] * (field[node + 1] - own - 0.5f * (slope.lo + gradient[node + 1].lo));
  if (j > 0) sum += model[1] * (field[node - nx] - own + 0.5f * (slope.hi + gradient[node - nx].hi));
  if (j + 1 < ny) sum += model[1] * (field[node + nx] - own - 0.5f * (slope.hi + gradient[node + nx].hi));
  pull[node] = sum;
}

// Bias that the edges cause, in field units: pull over information, both of the node and its neighbours
// within BIAS_RADIUS.
#define BIAS_RADIUS 1
__kernel __attribute__((reqd_work_group_size(WORK_GROUP, 1, 1))) void edge_bias(
    __global const float2* restrict information, __global const float2* restrict pull,
    __global float2* restrict bias, const int nx, const int ny) {
  const int node = get_global_id(0);
  if (node >= nx * ny) return;
  const int i = node % nx, j = node / nx;
  float2 h = 0.0f, sum = 0.0f;
  for (int n = max(j - BIAS_RADIUS, 0); n <= min(j + BIAS_RADIUS, ny - 1); ++n)
    for (int m = max(i - BIAS_RADIUS, 0); m <= min(i + BIAS_RADIUS, nx - 1); ++m) {
      h += information[m + nx * n];
      sum += pull[m + nx * n];
    }
  bias[node] = (float2)(h.x > 0.0f ? sum.x / h.x : 0.0f, h.y > 0.0f ? sum.y / h.y : 0.0f);
}

// What a displacement estimate can be trusted with: mean[node] = information averaged over the estimator's
// footprint and from it the standard deviation in metres. radii, nodes to each side, lateral i, j, axial i,
// j: of the footprint; of the place that shares a bias, at most as wide. tables (deviation.clh), lateral and
// axial each: deviation of the noise; what the noise alone gives edge_bias(); the smoothing's true bias over
// what edge_bias() sees of it. The bias of the place is the mean square of edge_bias(), less the noise's;
// nodes that hold next to no information (a shadow's) tell none. Items: (column, TRUSTED_ROWS rows), which
// share their rows' sums.
#define TRUSTED_ROWS 8
__kernel __attribute__((reqd_work_group_size(WORK_GROUP, 1, 1))) void uncertainty(
    __global const float2* restrict information, __global const float2* restrict bias,
    __global const float* restrict tables, __global const int4* restrict radii,
    __global float2* restrict mean, __global float2* restrict deviation_m, const int nx, const int ny,
    const float lateral_median, const float axial_median, const float line_pitch_m,
    const float sample_pitch_m) {
  const int i = get_global_id(0) % nx, top = get_global_id(0) / nx * TRUSTED_ROWS;
  if (top >= ny) return;
  const int4 footprint = radii[0], place = radii[1];
  const int reach_i = max(footprint.x, footprint.z), reach_j = max(footprint.y, footprint.w);
  const float2 silent = 1e-3f * (float2)(lateral_median, axial_median), none = 0.0f;
  float2 sum[TRUSTED_ROWS], squares[TRUSTED_ROWS], near[TRUSTED_ROWS];
  for (int r = 0; r < TRUSTED_ROWS; ++r) sum[r] = squares[r] = near[r] = none;
  for (int n = max(top - reach_j, 0); n <= min(top + TRUSTED_ROWS - 1 + reach_j, ny - 1); ++n) {
    float2 held = none, square = none, tells = none;
    for (int m = max(i - reach_i, 0); m <= min(i + reach_i, nx - 1); ++m) {
      const float2 h = information[m + nx * n], b = bias[m + nx * n];
      const int2 far = (int2)(abs(m - i)), told = (far <= place.xz) & (h > silent);
      held += select(none, h, far <= footprint.xz);
      square += select(none, b * b, told);
      tells -= convert_float2(told);  // a true comparison is -1
    }
    for (int r = 0; r < TRUSTED_ROWS; ++r) {
      const int2 far = (int2)(abs(n - top - r)), beside = far <= place.yw;
      sum[r] += select(none, held, far <= footprint.yw);
      squares[r] += select(none, square, beside);
      near[r] += select(none, tells, beside);
    }
  }
  const int2 columns = min(i + footprint.xz, nx - 1) - max(i - footprint.xz, 0) + 1;
  for (int r = 0; r < min(TRUSTED_ROWS, ny - top); ++r) {
    const int j = top + r, node = i + nx * j;
    const int2 rows = min(j + footprint.yw, ny - 1) - max(j - footprint.yw, 0) + 1;
    const float2 h = sum[r] / convert_float2(columns * rows);
    mean[node] = h;
    float2 table[3];
    for (int n = 0; n < 3; ++n)
      table[n] = (float2)(deviation_at(tables + 2 * n * DEVIATION_ENTRIES, h.x, lateral_median),
                          deviation_at(tables + (2 * n + 1) * DEVIATION_ENTRIES, h.y, axial_median));
    const float2 seen = fmax(squares[r] / fmax(near[r], 1e-6f) - table[1] * table[1], 0.0f);
    deviation_m[node] =
        (float2)(line_pitch_m, sample_pitch_m) * sqrt(table[0] * table[0] + table[2] * table[2] * seen);
  }
}
