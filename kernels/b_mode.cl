// Envelope of RF lines by quadrature (T2.9): at each sample the RF is correlated with one short packet of the
// centre frequency, cosine and sine. Sample k of A-line l lies at image[origin + l * stride + k], zeros around
// (frames.clh). Taps: (cosine, sine) of offset (t - half_taps) * tap_step samples.
#include "frames.clh"

#ifndef WORK_GROUP
#define WORK_GROUP 32
#endif

// power[k + samples * l] = squared envelope there. Per sample: 4 bytes for each tap, of which all but 8 are
// read by its neighbours too, and 4 flops.
__kernel __attribute__((reqd_work_group_size(WORK_GROUP, 1, 1))) void envelope_power(
    __global const float* restrict image, __constant float2* taps, __global float* restrict power,
    const Layout layout, const int samples, const int lines, const int half_taps, const int tap_step) {
  const int k = get_global_id(0), l = get_global_id(1);
  if (k >= samples || l >= lines) return;
  const int at = layout.origin + l * layout.stride + k;
  float cosine = 0.0f, sine = 0.0f;
  for (int t = -half_taps; t <= half_taps; ++t) {
    const float rf = image[at + t * tap_step];
    cosine += taps[t + half_taps].x * rf;
    sine += taps[t + half_taps].y * rf;
  }
  power[k + samples * l] = cosine * cosine + sine * sine;
}

// rows[l + lines * r] = mean power of samples [r * step, (r + 1) * step) of line l, as far as there are any.
__kernel __attribute__((reqd_work_group_size(WORK_GROUP, 1, 1))) void mean_rows(
    __global const float* restrict power, __global float* restrict rows, const int samples, const int lines,
    const int row_count, const int step) {
  const int l = get_global_id(0), r = get_global_id(1);
  if (l >= lines || r >= row_count) return;
  const int begin = r * step, end = min(begin + step, samples);
  float sum = 0.0f;
  for (int k = begin; k < end; ++k) sum += power[k + samples * l];
  rows[l + lines * r] = sum / (float)(end - begin);
}
