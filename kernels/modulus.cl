// Young's modulus by the reference stress (T3.1): E = (P / P_ref) E_ref eps_ref / eps_yy.

#ifndef WORK_GROUP
#define WORK_GROUP 32
#endif
#ifndef MEDIAN_RADIUS_MAX  // largest radius of modulus_median, in nodes
#define MEDIAN_RADIUS_MAX 2
#endif

// modulus = scale * ratio, ratio = amplitude * (E_ref eps_ref) / eps_yy; amplitude makes its median 1. NaN
// where nothing may be said: the node is not trusted, above row `first_row` (near field), |eps_yy| <
// min_strain, of the wrong sign, or the ratio outside [1 / range, range]. strain: eps_yy. 13 bytes, 5 flops
// per node.
__kernel __attribute__((reqd_work_group_size(WORK_GROUP, 1, 1))) void reference_stress(
    __global const float* restrict strain, __global const uchar* restrict trusted,
    __global const float* restrict stress, __global float* restrict modulus, const int nx, const int ny,
    const float amplitude, const float scale, const float min_strain, const float range,
    const int first_row) {
  const int node = get_global_id(0);
  if (node >= nx * ny) return;
  const float own = strain[node], ratio = amplitude * stress[node] / own;
  const bool said = trusted[node] && node / nx >= first_row && fabs(own) >= min_strain && ratio <= range &&
                    ratio >= 1.0f / range;
  modulus[node] = said ? scale * ratio : NAN;
}

// Median over the said nodes within `radius` of each said node; a node that is not said stays NaN, and one
// that stands alone (less than a third of its neighbourhood said) becomes NaN.
__kernel __attribute__((reqd_work_group_size(WORK_GROUP, 1, 1))) void modulus_median(
    __global const float* restrict modulus, __global float* restrict out, const int nx, const int ny,
    const int radius) {
  const int node = get_global_id(0);
  if (node >= nx * ny) return;
  const int i = node % nx, j = node / nx;
  float v[(2 * MEDIAN_RADIUS_MAX + 1) * (2 * MEDIAN_RADIUS_MAX + 1)];
  int count = 0, inside = 0;
  for (int n = max(j - radius, 0); n <= min(j + radius, ny - 1); ++n)
    for (int m = max(i - radius, 0); m <= min(i + radius, nx - 1); ++m) {
      const float e = modulus[m + nx * n];
      ++inside;
      if (isnan(e)) continue;
      int p = count++;
      for (; p > 0 && v[p - 1] > e; --p) v[p] = v[p - 1];
      v[p] = e;
    }
  const bool said = !isnan(modulus[node]) && 3 * count >= inside;
  out[node] = said ? 0.5f * (v[(count - 1) / 2] + v[count / 2]) : NAN;
}
