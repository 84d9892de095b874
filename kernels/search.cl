// Search for the displacement of a pair of RF frames by normalised cross-correlation (T2.1).
//
// Displacement fields are as in displacement.cl.
// Vectors of 8 run along the axial axis; one work-item serves one node, so no barrier is needed.

#include "frames.clh"

#ifndef WORK_GROUP  // work-items of a group, all kernels of this file
#define WORK_GROUP 32
#endif

// Position of the largest of three equally spaced values by a parabola, in (-1/2, 1/2). Biased (T2.2): only a
// start for Gauss-Newton.
float parabola(const float before, const float peak, const float after) {
  const float curvature = before - 2.0f * peak + after;
  return curvature < -1e-6f ? clamp(0.5f * (before - after) / curvature, -0.5f, 0.5f) : 0.0f;
}

// Whether a node stands where its line holds echoes. Few samples correlate with anything: what the windows of
// nodes in silence hear of echoes beside it counts as no correlation.
bool hears(__global const int2* restrict spans, const Nodes g, const int node) {
  const int2 span = spans[line_of(g, node)];
  const int sample = sample_of(g, node);
  return sample >= span.x && sample < span.y;
}

// `count` blocks of 8 samples that start `step` apart from `first` on.
typedef struct {
  int first, step, count;
} Blocks;

// Energy of the axial windows of every line: out(k) = sum over -half_axial..half_axial, every
// sample_stride-th, of image(k + n)^2, for the samples k of the blocks of two images. Items: (block, line,
// image).
__kernel __attribute__((reqd_work_group_size(16, 1, 1))) void window_energy(
    __global const float* restrict pre, __global const float* restrict post, __global float* restrict pre_out,
    __global float* restrict post_out, const Blocks of_pre, const Blocks of_post, const int half_axial,
    const int sample_stride, const Layout layout) {
  const bool second = get_global_id(2) != 0;
  const Blocks blocks = second ? of_post : of_pre;
  __global const float* const image = second ? post : pre;
  __global float* const out = second ? post_out : pre_out;
  const int block = get_global_id(0);
  if (block >= blocks.count) return;
  const int at = layout.origin + (int)get_global_id(1) * layout.stride + blocks.first + blocks.step * block;
  float8 sum = 0.0f;
  for (int n = -half_axial; n <= half_axial; n += sample_stride) {
    const float8 v = vload8(0, image + at + n);
    sum = fma(v, v, sum);
  }
  vstore8(sum, 0, out + at);
}

// Windows and lags of a search (service/imaging/tracking/search.h). Window: lines
// -half_lateral..half_lateral, samples -half_axial..half_axial, every line_stride-th and sample_stride-th of
// them (decimation: the products stay clear of DC).
typedef struct {
  int half_axial, half_lateral, sample_stride, line_stride;
} Window;
// Axial lags first .. first + 8 chunks - 1, `laterals` lateral lags first_lateral + m lateral_step. Not
// looked at: axial lags beyond min_reach + reach_slope * sample, lateral ones a whole step beyond the
// larger of lateral_min and lateral_slope * distance from the grid's middle line.
typedef struct {
  int first, chunks, first_lateral, lateral_step, laterals;
  float min_reach, reach_slope, lateral_min, lateral_slope;
} Lags;

// Normalised cross-correlation (T2.1) of the window around each node, for 8 axial lags x NCC_LATERALS lateral
// lags per work-item: out[((node * laterals + m) * chunks + c) * 8 + n], axial lag first + 8 c + n; nothing
// is written where it is not looked at. Energies of the windows from window_energy(). Per item and window
// sample: 1 + NCC_LATERALS loads, 16 NCC_LATERALS flops, in two independent chains each (one chain waits for
// its own sum).
#define NCC_LATERALS 3
__kernel __attribute__((reqd_work_group_size(WORK_GROUP, 1, 1))) void ncc(
    __global const float* restrict pre, __global const float* restrict post,
    __global const float* restrict pre_energy, __global const float* restrict post_energy,
    __global float* restrict out, const Nodes g, const Layout layout, const Window window, const Lags lags) {
  const int id = get_global_id(0), groups = (lags.laterals + NCC_LATERALS - 1) / NCC_LATERALS;
  if (id >= g.nx * g.ny * groups * lags.chunks) return;
  const int chunk = id % lags.chunks, m = id / lags.chunks % groups * NCC_LATERALS,
            node = id / (lags.chunks * groups);
  const int line = line_of(g, node), sample = sample_of(g, node), lag = lags.first + 8 * chunk;
  const float reach = lags.min_reach + lags.reach_slope * (float)sample;
  const float from_middle = (float)g.line_step * fabs((float)(node % g.nx) - 0.5f * (float)(g.nx - 1));
  const float lateral_reach =
      fmax(lags.lateral_min, lags.lateral_slope * from_middle) + (float)lags.lateral_step;
  if ((float)lag > reach || (float)(lag + 7) < -reach) return;
  const int half_axial = window.half_axial, sample_stride = window.sample_stride;
  int shift[NCC_LATERALS];  // to the lateral lags; beyond the last one that is looked at the last again
  bool looked[NCC_LATERALS], any = false;
#pragma unroll
  for (int q = 0; q < NCC_LATERALS; ++q) {
    const int lateral = lags.first_lateral + min(m + q, lags.laterals - 1) * lags.lateral_step;
    looked[q] = m + q < lags.laterals && (float)abs(lateral) < lateral_reach;
    any |= looked[q];
    shift[q] = lateral * layout.stride;
  }
  if (!any) return;
  float energy = 0.0f;
  float8 energies[NCC_LATERALS], even[NCC_LATERALS], odd[NCC_LATERALS];
#pragma unroll
  for (int q = 0; q < NCC_LATERALS; ++q) energies[q] = even[q] = odd[q] = (float8)(0.0f);
  int outermost = window.half_lateral;  // as far left as right
  while (2 * outermost % window.line_stride != 0) --outermost;
  for (int l = -outermost; l <= outermost; l += window.line_stride) {
    const int at = layout.origin + (line + l) * layout.stride + sample;
    __global const float* const a = pre + at;
    __global const float* const b = post + at + lag;
    energy += pre_energy[at];
#pragma unroll
    for (int q = 0; q < NCC_LATERALS; ++q) energies[q] += vload8(0, post_energy + at + lag + shift[q]);
    int k = -half_axial;
    for (; k + sample_stride <= half_axial; k += 2 * sample_stride)
#pragma unroll
      for (int q = 0; q < NCC_LATERALS; ++q) {
        even[q] = fma((float8)(a[k]), vload8(0, b + shift[q] + k), even[q]);
        odd[q] = fma((float8)(a[k + sample_stride]), vload8(0, b + shift[q] + k + sample_stride), odd[q]);
      }
    if (k <= half_axial)
#pragma unroll
      for (int q = 0; q < NCC_LATERALS; ++q)
        even[q] = fma((float8)(a[k]), vload8(0, b + shift[q] + k), even[q]);
  }
#pragma unroll
  for (int q = 0; q < NCC_LATERALS; ++q)
    if (looked[q])
      vstore8((even[q] + odd[q]) * rsqrt(fmax(energy * energies[q], (float8)(1e-20f))),
              (node * lags.laterals + m + q) * lags.chunks + chunk, out);
}

// Of a volume of ncc() the largest over the lateral lags: out[(node * chunks + c) * 8 + n].
__kernel __attribute__((reqd_work_group_size(WORK_GROUP, 1, 1))) void best_lateral(
    __global const float* restrict volume, __global const int2* restrict spans, __global float* restrict out,
    const Nodes g, const int chunks, const int lateral_count) {
  const int id = get_global_id(0);
  if (id >= g.nx * g.ny * chunks) return;
  const int first = id / chunks * lateral_count * chunks + id % chunks;
  float8 best = vload8(first, volume);
  for (int m = 1; m < lateral_count; ++m) best = fmax(best, vload8(first + m * chunks, volume));
  vstore8(hears(spans, g, id / chunks) ? best : (float8)(0.0f), id, out);
}

// Of a volume of ncc() the lateral lags at one axial lag of each node, lags[node] from the first:
// out[node * lateral_count + m].
__kernel __attribute__((reqd_work_group_size(WORK_GROUP, 1, 1))) void laterals_at(
    __global const float* restrict volume, __global const int2* restrict spans,
    __global const int* restrict lags, __global float* restrict out, const Nodes g, const int chunks,
    const int lateral_count) {
  const int id = get_global_id(0), node = id / lateral_count;
  if (node >= g.nx * g.ny) return;
  out[id] = hears(spans, g, node) ? volume[id * chunks * 8 + lags[node]] : 0.0f;
}

// The peak of ncc() with one chunk of axial lags, lateral_step 1: adds its sub-sample position to `field`.
__kernel __attribute__((reqd_work_group_size(WORK_GROUP, 1, 1))) void ncc_peak(
    __global const float* restrict volume, __global const int2* restrict spans,
    __global const float2* restrict field, __global float2* restrict out, __global float* restrict peak,
    const Nodes g, const int first_lag, const int first_lateral, const int lateral_count) {
  const int node = get_global_id(0);
  if (node >= g.nx * g.ny) return;
  __global const float* const v = volume + node * lateral_count * 8;
  int best = 0;
  for (int n = 1; n < lateral_count * 8; ++n) best = v[n] > v[best] ? n : best;
  const int lag = best % 8, m = best / 8;
  const float axial = lag > 0 && lag < 7 ? parabola(v[best - 1], v[best], v[best + 1]) : 0.0f;
  const float lateral = m > 0 && m < lateral_count - 1 ? parabola(v[best - 8], v[best], v[best + 8]) : 0.0f;
  out[node] = field[node] + (float2)((float)(first_lateral + m) + lateral, (float)(first_lag + lag) + axial);
  peak[node] = hears(spans, g, node) ? v[best] : 0.0f;
}
