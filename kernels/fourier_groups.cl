// Real two-dimensional Fourier transforms of planes, on GPUs (processors: fourier.cl). A work-group takes so
// many rows, or columns, as hold four complex numbers for each of its items; these lie in local memory, with
// barriers between stages. Layouts: service/solver/fourier.h. The inverse is the same with parts exchanged.
#include "fourier.clh"

#ifndef GROUP
#define GROUP 128
#endif
#define ROWS (4 * GROUP / HALF)  // of a group
#define COLUMNS (4 * GROUP / NZ)

// Of Stockham's transforms of `length` numbers each, the stage that finds them done in `done` places; number
// n of line l lies at l line + n step. A line, or all lines at one n, lie next to each other.
void stage4(local real* re, local real* im, const int length, const int line, const int step, const int done,
            global const real* restrict roots) {
  const int item = get_local_id(0), quarter = length / 4, apart = quarter * step;
  const int l = step == 1 ? item / quarter : item % step, t = step == 1 ? item % quarter : item / step;
  const int q = t % done, p = t / done, from = l * line + t * step;
  const real ar = re[from] + re[from + 2 * apart], ai = im[from] + im[from + 2 * apart];
  const real br = re[from] - re[from + 2 * apart], bi = im[from] - im[from + 2 * apart];
  const real cr = re[from + apart] + re[from + 3 * apart], ci = im[from + apart] + im[from + 3 * apart];
  const real dr = re[from + apart] - re[from + 3 * apart], di = im[from + apart] - im[from + 3 * apart];
  const real r[4] = {ar + cr, br + di, ar - cr, br - di}, i[4] = {ai + ci, bi - dr, ai - ci, bi + dr};
  barrier(CLK_LOCAL_MEM_FENCE);
#pragma unroll
  for (int j = 0; j < 4; ++j) {
    const int root = 2 * (ROOTS / length) * done * j * p, to = l * line + (q + done * (4 * p + j)) * step;
    re[to] = r[j] * roots[root] - i[j] * roots[root + 1];
    im[to] = r[j] * roots[root + 1] + i[j] * roots[root];
  }
  barrier(CLK_LOCAL_MEM_FENCE);
}

// The last stage, where four does not divide the length.
void stage2(local real* re, local real* im, const int length, const int line, const int step) {
  const int half_length = length / 2;
#pragma unroll
  for (int part = 0; part < 2; ++part) {
    const int b = get_local_id(0) + part * GROUP;
    const int l = step == 1 ? b / half_length : b % step, t = step == 1 ? b % half_length : b / step;
    const int at = l * line + t * step, other = at + half_length * step;
    const real r = re[at] - re[other], i = im[at] - im[other];
    re[at] += re[other];
    im[at] += im[other];
    re[other] = r;
    im[other] = i;
  }
  barrier(CLK_LOCAL_MEM_FENCE);
}

void transform(local real* re, local real* im, const int length, const int line, const int step,
               global const real* restrict roots) {
  if (length >= 4) stage4(re, im, length, line, step, 1, roots);
  if (length >= 16) stage4(re, im, length, line, step, 4, roots);
  if (length >= 64) stage4(re, im, length, line, step, 16, roots);
  if (length >= 256) stage4(re, im, length, line, step, 64, roots);
  if (popcount(length - 1) % 2 == 1) stage2(re, im, length, line, step);
}

// Rows of `count` planes from `first` on.
kernel __attribute__((reqd_work_group_size(GROUP, 1, 1))) void rows_forward(global const real* restrict field,
                                                                            global real* restrict spectrum,
                                                                            global const real* restrict roots,
                                                                            const int first,
                                                                            const int count) {
  local real re[4 * GROUP], im[4 * GROUP];
  const int begin = ROWS * get_group_id(0), rows = count * NZ;
  field += (size_t)first * NZ * NX;
  spectrum += (size_t)first * 2 * PART;
  for (int n = get_local_id(0); n < ROWS * NX; n += GROUP) {
    const real value = begin + n / NX < rows ? field[(size_t)begin * NX + n] : 0;
    if (n % 2 == 0)
      re[n / 2] = value;
    else
      im[n / 2] = value;
  }
  barrier(CLK_LOCAL_MEM_FENCE);
  transform(re, im, HALF, HALF, 1, roots);
  for (int n = get_local_id(0); n < ROWS * PITCH; n += GROUP) {
    const int row = begin + n / PITCH, k = n % PITCH;
    if (row >= rows) break;
    real xr = 0, xi = 0;
    if (k <= HALF) {
      const int at = n / PITCH * HALF + k % HALF, mirror = n / PITCH * HALF + (HALF - k) % HALF;
      const real c = k < HALF ? roots[2 * (ROOTS / NX) * k] : -1;
      const real s = k < HALF ? roots[2 * (ROOTS / NX) * k + 1] : 0;
      const real odd_r = REAL(0.5) * (im[at] + im[mirror]), odd_i = REAL(0.5) * (re[mirror] - re[at]);
      xr = REAL(0.5) * (re[at] + re[mirror]) + odd_r * c - odd_i * s;
      xi = REAL(0.5) * (im[at] - im[mirror]) + odd_r * s + odd_i * c;
    }
    global real* to = spectrum + (size_t)(row / NZ) * 2 * PART + row % NZ * PITCH + k;
    to[0] = xr;
    to[PART] = xi;
  }
}

kernel __attribute__((reqd_work_group_size(GROUP, 1, 1))) void rows_backward(
    global const real* restrict spectrum, global real* restrict field, global const real* restrict roots,
    const int first, const int count) {
  local real re[4 * GROUP], im[4 * GROUP];
  const int begin = ROWS * get_group_id(0), rows = count * NZ;
  const real scale = REAL(1.0) / (NX * NZ);
  field += (size_t)first * NZ * NX;
  spectrum += (size_t)first * 2 * PART;
  for (int n = get_local_id(0); n < ROWS * HALF; n += GROUP) {
    const int row = min(begin + n / HALF, rows - 1), k = n % HALF;
    global const real* from = spectrum + (size_t)(row / NZ) * 2 * PART + row % NZ * PITCH;
    const real xr = from[k], xi = k > 0 ? from[PART + k] : 0;  // imaginary parts of real numbers' sums
    const real mr = from[HALF - k], mi = k > 0 ? from[PART + HALF - k] : 0;
    const real c = roots[2 * (ROOTS / NX) * k], s = roots[2 * (ROOTS / NX) * k + 1];
    const real dr = xr - mr, di = xi + mi;
    re[n] = scale * (xr + mr + dr * s - di * c);
    im[n] = scale * (xi - mi + dr * c + di * s);
  }
  barrier(CLK_LOCAL_MEM_FENCE);
  transform(im, re, HALF, HALF, 1, roots);
  for (int n = get_local_id(0); n < ROWS * NX; n += GROUP)
    if (begin + n / NX < rows) field[(size_t)begin * NX + n] = n % 2 == 0 ? re[n / 2] : im[n / 2];
}

// Columns of planes from `first` on, in place.
kernel __attribute__((reqd_work_group_size(GROUP, 1, 1))) void columns(global real* restrict spectrum,
                                                                       global const real* restrict roots,
                                                                       const int first, const int exchanged) {
  local real re[4 * GROUP], im[4 * GROUP];
  const int begin = COLUMNS * get_group_id(0);
  spectrum += (size_t)(first + (int)get_group_id(1)) * 2 * PART + begin;
  for (int n = get_local_id(0); n < COLUMNS * NZ; n += GROUP) {
    const bool inside = begin + n % COLUMNS <= HALF;
    const int at = n / COLUMNS * PITCH + n % COLUMNS;
    re[n] = inside ? spectrum[at] : 0;
    im[n] = inside ? spectrum[PART + at] : 0;
  }
  barrier(CLK_LOCAL_MEM_FENCE);
  transform(exchanged ? im : re, exchanged ? re : im, NZ, 1, COLUMNS, roots);
  for (int n = get_local_id(0); n < COLUMNS * NZ; n += GROUP) {
    const int at = n / COLUMNS * PITCH + n % COLUMNS;
    if (begin + n % COLUMNS > HALF) continue;
    spectrum[at] = re[n];
    spectrum[PART + at] = im[n];
  }
}
