// What of a motion-compensated pair's difference is no noise (T2.3d). Companding by a displacement gradient e
// stretches and shears the pulse: its spectrum A(k) then differs from that of pre by the factor
// 1 - grad_k ln A . e^T k, even in k, for a Gaussian pulse a sum of 1, k_y^2, k_x k_y and k_x^2 around the
// carrier. So the difference holds a sum of the mean and its even derivatives, in phase with the echoes and a
// quarter period from their gradients: it moves nothing, however large it is.
//
// Images and nodes as in frames.clh.

#include "frames.clh"
#include "robust.clh"
#include "vectors.clh"

#ifndef WORK_GROUP
#define WORK_GROUP 32
#endif

// With r = (m, m_yy, m_xy, m_xx) of the mean m and d the difference, sums over the pixels around a node,
// robust weights w as of data_term(), refinement.cl: pulses[node] = upper triangle of w r r^T by rows (10), w
// r d (4), w d^2. Lines without both neighbours are left out. Per 8 pixels: 14 vector loads, ~420 flops.
__kernel __attribute__((reqd_work_group_size(WORK_GROUP, 1, 1))) void pulse_sums(
    __global const float* restrict mean, __global const float* restrict difference,
    __global const float* restrict noise, __global float16* restrict pulses, const Nodes g,
    const Layout layout, const int line_count) {
  const int node = get_global_id(0);
  if (node >= g.nx * g.ny) return;
  const int line_step = g.line_step, stride = layout.stride;
  const int chunks = (g.sample_step + 7) / 8, first = line_of(g, node) - line_step / 2;
  const int start = layout.origin + sample_of(g, node) - 4 * chunks;
  const float doubt = robust_doubt(noise[node]);
  float8 mm = 0.0f, my = 0.0f, mt = 0.0f, mx = 0.0f, yy = 0.0f, yt = 0.0f, yx = 0.0f, tt = 0.0f, tx = 0.0f,
         xx = 0.0f;
  float8 md = 0.0f, yd = 0.0f, td = 0.0f, xd = 0.0f, dd = 0.0f;  // y: m_yy, t: m_xy, x: m_xx
  for (int l = max(first, 1); l < min(first + line_step, line_count - 1); ++l) {
    __global const float* const s = mean + start + l * stride;
    __global const float* const d = difference + start + l * stride;
    for (int c = 0; c < 8 * chunks; c += 8) {
      __global const float* const at = s + c;
      const float8 m = LOAD8(at), e = LOAD8(d + c), left = LOAD8(at - stride), right = LOAD8(at + stride);
      const float8 y = 1.5f * (LOAD8(at + 1) + LOAD8(at - 1)) - 0.15f * (LOAD8(at + 2) + LOAD8(at - 2)) +
                       (1.0f / 90.0f) * (LOAD8(at + 3) + LOAD8(at - 3)) - (49.0f / 18.0f) * m;
      const float8 t = 0.25f * (LOAD8(at + stride + 1) - LOAD8(at + stride - 1) - LOAD8(at - stride + 1) +
                                LOAD8(at - stride - 1));
      const float8 x = left + right - 2.0f * m;
      const float8 w = 1.0f / (1.0f + doubt * e * e);
      const float8 wm = w * m, wy = w * y, wt = w * t, wx = w * x;
      mm = fma(wm, m, mm);
      my = fma(wm, y, my);
      mt = fma(wm, t, mt);
      mx = fma(wm, x, mx);
      yy = fma(wy, y, yy);
      yt = fma(wy, t, yt);
      yx = fma(wy, x, yx);
      tt = fma(wt, t, tt);
      tx = fma(wt, x, tx);
      xx = fma(wx, x, xx);
      md = fma(wm, e, md);
      yd = fma(wy, e, yd);
      td = fma(wt, e, td);
      xd = fma(wx, e, xd);
      dd = fma(w * e, e, dd);
    }
  }
  pulses[node] = (float16)(sum8(mm), sum8(my), sum8(mt), sum8(mx), sum8(yy), sum8(yt), sum8(yx), sum8(tt),
                           sum8(tx), sum8(xx), sum8(md), sum8(yd), sum8(td), sum8(xd), sum8(dd), 0.0f);
}

// Takes the pulse's part (pulse_sums(), least squares over (2 radius + 1)^2 nodes) off noise and information
// of local_noise(), refinement.cl; a LEAST_LEFT of the noise is always believed.
#define LEAST_LEFT 0.05f
__kernel __attribute__((reqd_work_group_size(WORK_GROUP, 1, 1))) void pulse_noise(
    __global const float16* restrict pulses, __global float* restrict noise,
    __global float2* restrict information, const int nx, const int ny, const int radius) {
  const int node = get_global_id(0);
  if (node >= nx * ny || !(noise[node] > 0.0f)) return;
  const int i = node % nx, j = node / nx;
  float16 sum = 0.0f;
  for (int n = max(j - radius, 0); n <= min(j + radius, ny - 1); ++n)
    for (int m = max(i - radius, 0); m <= min(i + radius, nx - 1); ++m) sum += pulses[m + nx * n];
  float s[16], a[4][4], b[4];
  vstore16(sum, 0, s);
  for (int r = 0, at = 0; r < 4; ++r) {
    b[r] = s[10 + r];
    for (int c = r; c < 4; ++c) a[r][c] = s[at++];
  }
  // Forward elimination: what each of r adds to the explained square. One that is next to none, or a sum of
  // those before it, adds nothing.
  float explained = 0.0f;
  const float own[4] = {s[0], s[4], s[7], s[9]};
  for (int p = 0; p < 4; ++p) {
    if (!(a[p][p] > 1e-4f * own[p])) continue;
    explained += b[p] * b[p] / a[p][p];
    for (int r = p + 1; r < 4; ++r) {
      const float f = a[p][r] / a[p][p];
      for (int c = r; c < 4; ++c) a[r][c] -= f * a[p][c];
      b[r] -= f * b[p];
    }
  }
  const float left = s[14] > 0.0f ? fmax(1.0f - explained / s[14], LEAST_LEFT) : 1.0f;
  noise[node] *= left;
  information[node] /= left;
}
