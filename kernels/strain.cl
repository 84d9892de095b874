// Strain by least squares (T2.4): a plane is fitted to both displacement components over a kernel of
// (2 half_columns + 1) x (2 half_rows + 1) nodes, trusted nodes only; its slopes are the strain tensor.
//   u_x ~ a + b x + c y, u_y ~ d + e x + f y;  eps_xx = b, eps_yy = f, eps_xy = (c + e) / 2
// Node (i, j) has index i + nx j. field: metres (x lateral, y axial). Per node and kernel node: 13 bytes, ~20
// flops.
#include "deviation.clh"

#ifndef WORK_GROUP
#define WORK_GROUP 32
#endif

// strain[node] = (eps_xx, eps_yy, eps_xy, rms residual of u_y in metres); all NaN and trusted_out = 0 where
// less than `min_fraction` of the kernel's nodes inside the grid are trusted or they do not span a plane.
// trusted_out = 0 also where the residual exceeds `residual_limit_m` or the node itself is not trusted.
__kernel __attribute__((reqd_work_group_size(WORK_GROUP, 1, 1))) void strain(
    __global const float2* restrict field, __global const uchar* restrict trusted,
    __global float4* restrict strain_out, __global uchar* restrict trusted_out, const int nx, const int ny,
    const float dx_m, const float dy_m, const int half_columns, const int half_rows, const float min_fraction,
    const float residual_limit_m) {
  const int node = get_global_id(0);
  if (node >= nx * ny) return;
  const int i = node % nx, j = node / nx;
  const int left = max(i - half_columns, 0), right = min(i + half_columns, nx - 1);
  const int upper = max(j - half_rows, 0), lower = min(j + half_rows, ny - 1);
  const float2 origin = field[node];  // differences keep float accurate for large rigid motion
  float n = 0.0f, sx = 0.0f, sy = 0.0f, sxx = 0.0f, sxy = 0.0f, syy = 0.0f, uu = 0.0f;
  float2 u = 0.0f, xu = 0.0f, yu = 0.0f;
  for (int r = upper; r <= lower; ++r)
    for (int c = left; c <= right; ++c) {
      const float w = (float)trusted[c + nx * r];
      const float2 v = w * (field[c + nx * r] - origin);
      const float x = (float)(c - i), y = (float)(r - j);
      n += w;
      sx += w * x;
      sy += w * y;
      sxx += w * x * x;
      sxy += w * x * y;
      syy += w * y * y;
      u += v;
      xu += x * v;
      yu += y * v;
      uu += v.y * v.y;
    }
  const float inside = (float)((right - left + 1) * (lower - upper + 1));
  // Normal equations of the slopes after elimination of the constant.
  const float count = fmax(n, 1.0f);
  const float cxx = sxx - sx * sx / count, cxy = sxy - sx * sy / count, cyy = syy - sy * sy / count;
  const float2 bx = xu - sx / count * u, by = yu - sy / count * u;
  const float determinant = cxx * cyy - cxy * cxy;
  if (n < min_fraction * inside - 1e-3f || n < 4.0f || determinant <= 0.05f * cxx * cyy ||
      cxx * cyy <= 0.0f) {
    strain_out[node] = (float4)(NAN);
    trusted_out[node] = 0;
    return;
  }
  const float2 slope_x = (cyy * bx - cxy * by) / determinant, slope_y = (cxx * by - cxy * bx) / determinant;
  const float squares = uu - u.y * u.y / count - slope_x.y * bx.y - slope_y.y * by.y;
  const float residual = sqrt(fmax(squares, 0.0f) / count);
  strain_out[node] =
      (float4)(slope_x.x / dx_m, slope_y.y / dy_m, 0.5f * (slope_y.x / dy_m + slope_x.y / dx_m), residual);
  trusted_out[node] = trusted[node] && residual <= residual_limit_m ? 1 : 0;
}

// What the kernel takes off its own result, (eps_xx, eps_yy, eps_xy) each: a plane's slope is the strain
// within weighed by a parabola along it, by a box across. Trusted nodes alone; NaN where the strain is.
__kernel __attribute__((reqd_work_group_size(WORK_GROUP, 1, 1))) void strain_rest(
    __global const float4* restrict strain, __global const uchar* restrict trusted,
    __global float* restrict rest, const int nx, const int ny, const int half_columns, const int half_rows) {
  const int node = get_global_id(0);
  if (node >= nx * ny) return;
  const int i = node % nx, j = node / nx;
  float3 sum = 0.0f, count = 0.0f;
  for (int r = max(j - half_rows, 0); r <= min(j + half_rows, ny - 1); ++r)
    for (int c = max(i - half_columns, 0); c <= min(i + half_columns, nx - 1); ++c) {
      const int at = c + nx * r;
      if (!trusted[at] && at != node) continue;
      const float along = (float)(half_columns * (half_columns + 1) - (c - i) * (c - i)),
                  down = (float)(half_rows * (half_rows + 1) - (r - j) * (r - j));
      // Shear is half of a slope along and half of one down.
      const float3 w = (float3)(along, down,
                                0.5f * (along / (half_columns * (half_columns + 1)) +
                                        down / (half_rows * (half_rows + 1))));
      sum += w * strain[at].xyz;
      count += w;
    }
  vstore3(strain[node].xyz - sum / count, node, rest);
}

// Standard deviations of (eps_xx, eps_yy, eps_xy) and the noise's part of that of eps_yy; NaN where the
// strain is. tables (deviation.clh) of the slopes du_x/dx, du_x/dy, du_y/dx, du_y/dy, at the information of
// the place: deviation of the noise; what the noise alone gives strain_rest(); the true bias over what
// strain_rest() sees of it. The bias is the mean square of strain_rest() over a kernel, less what noise alone
// may make of that: such a mean scatters by about a quarter of itself.
__kernel __attribute__((reqd_work_group_size(WORK_GROUP, 1, 1))) void strain_deviation(
    __global const float2* restrict information, __global const float4* restrict strain,
    __global const float* restrict rest, __global const float* restrict tables,
    __global float4* restrict deviation, const int nx, const int ny, const int half_columns,
    const int half_rows, const float lateral_median, const float axial_median) {
  const int node = get_global_id(0);
  if (node >= nx * ny) return;
  if (isnan(strain[node].x)) {
    deviation[node] = (float4)(NAN);
    return;
  }
  const int i = node % nx, j = node / nx;
  float3 squares = 0.0f;
  float near = 0.0f;
  for (int r = max(j - half_rows, 0); r <= min(j + half_rows, ny - 1); ++r)
    for (int c = max(i - half_columns, 0); c <= min(i + half_columns, nx - 1); ++c) {
      const float3 b = vload3(c + nx * r, rest);
      if (isnan(b.x)) continue;
      squares += b * b;
      near += 1.0f;
    }
  const float2 h = information[node];
  float3 table[3];
  for (int n = 0; n < 3; ++n) {
    float4 slopes;
    slopes.x = deviation_at(tables + (4 * n) * DEVIATION_ENTRIES, h.x, lateral_median);
    slopes.y = deviation_at(tables + (4 * n + 1) * DEVIATION_ENTRIES, h.x, lateral_median);
    slopes.z = deviation_at(tables + (4 * n + 2) * DEVIATION_ENTRIES, h.y, axial_median);
    slopes.w = deviation_at(tables + (4 * n + 3) * DEVIATION_ENTRIES, h.y, axial_median);
    table[n] = (float3)(slopes.x, slopes.w, 0.5f * (n < 2 ? hypot(slopes.y, slopes.z) : slopes.y + slopes.z));
  }
  const float3 seen = fmax(squares / fmax(near, 1.0f) - 1.25f * table[1] * table[1], 0.0f);
  deviation[node] = (float4)(sqrt(table[0] * table[0] + table[2] * table[2] * seen), table[0].y);
}
