// Conjugate gradients on solid tissue (solid.cl) joined with Fourier transforms, on processors (GPUs:
// solid_groups.cl): items, GROUP 1, as of fourier.cl.
#define GROUP 1
#include "fourier_items.clh"
#include "solid_marks.clh"

// u += alpha d, r -= alpha K d where there was an iteration before (before >= 0), and the transform of r.
// Rows of d begin and end with `margin` numbers more.
kernel void step_forward(global const real* restrict d, global const real* restrict kd,
                         global const real* u_from, global real* u, global const real* r_from, global real* r,
                         global const accum* restrict curvature, global real* restrict marks,
                         global real* restrict spectrum, global const real* restrict roots, const int count,
                         const int margin, const int parts, const int before) {
  const int done = PLANES * get_global_id(0), planes = min(count - done, PLANES);
  if (planes <= 0) return;
  const int plane = NZ * NX;
  global const real* at = r_from + done * plane;
  if (before >= 0) {
    const real alpha = step_length(marks, curvature, parts, before, 0);
    for (int row = done * NZ; row < (done + planes) * NZ; ++row) {
      global const real* along = d + row * (NX + 2 * margin) + margin;
      for (int n = row * NX; n < (row + 1) * NX; n += WIDTH, along += WIDTH) {
        *(global Loose*)(u + n) = *(global const Loose*)(u_from + n) + alpha * *(global const Loose*)along;
        *(global Loose*)(r + n) = *(global const Loose*)(r_from + n) - alpha * *(global const Loose*)(kd + n);
      }
    }
    at = r + done * plane;
  }
  forward_of(at, spectrum + (size_t)done * 2 * PART, roots, planes);
}

// The transform back to z, and partial sums of r . z, one of each item: by rows, then over them.
kernel void backward_dot(global real* restrict spectrum, global real* restrict z,
                         global const real* restrict r, global real* restrict marks,
                         global const real* restrict roots, const int count) {
  const int done = PLANES * get_global_id(0), planes = min(count - done, PLANES);
  if (planes <= 0) return;
  backward_of(spectrum + (size_t)done * 2 * PART, z + (size_t)done * NZ * NX, roots, planes);
  vec sums[4] = {(vec)(0), (vec)(0), (vec)(0), (vec)(0)};
  for (int row = 0; row < planes * NZ; ++row) {
    vec sum = (vec)(0);
    for (int n = (done * NZ + row) * NX; n < (done * NZ + row + 1) * NX; n += WIDTH)
      sum += *(global const Loose*)(z + n) * *(global const Loose*)(r + n);
    sums[row % 4] += sum;
  }
  marks[PARTS + get_global_id(0)] = sum_lanes((sums[0] + sums[1]) + (sums[2] + sums[3]));
}

// Between the sweeps, planes first .. first + planes - 1 of the surface: how it would move, back from its
// spectra; q = M B of that, and p -= alpha dq where there was an iteration before; -B^T q, and its spectra. M
// is symmetric: q is the sum of its rows times B's numbers. One item.
kernel void patch_surface(global real* restrict spectrum, global real* restrict field,
                          global const real* restrict roots, global const real* restrict inverse,
                          global const int* restrict unknowns, global const int* restrict slots,
                          global real* restrict q, global const real* restrict dq, global const real* p_from,
                          global real* p, global const real* restrict marks, const int first,
                          const int planes, const int count, const int before) {
  if (get_global_id(0) != 0) return;
  for (int n = first; n < first + planes; n += PLANES)
    backward_of(spectrum + n * 2 * PART, field + n * NZ * NX, roots, min(PLANES, first + planes - n));
  const real alpha = before < 0 ? 0 : marks[MARKS_OF_ITERATION * before + ALPHA];
  int row = 0;
  for (; row + WIDTH <= count; row += WIDTH) {
    vec even = (vec)(0), odd = (vec)(0);
    int n = 0;
    for (; n + 2 <= count; n += 2) {
      even += field[unknowns[n]] * *(global const Loose*)(inverse + n * count + row);
      odd += field[unknowns[n + 1]] * *(global const Loose*)(inverse + (n + 1) * count + row);
    }
    if (n < count) even += field[unknowns[n]] * *(global const Loose*)(inverse + n * count + row);
    *(global Loose*)(q + row) = even + odd;
  }
  for (; row < count; ++row) {
    real even = 0, odd = 0;
    for (int n = 0; n + 2 <= count; n += 2) {
      even += field[unknowns[n]] * inverse[n * count + row];
      odd += field[unknowns[n + 1]] * inverse[(n + 1) * count + row];
    }
    if (count % 2 == 1) even += field[unknowns[count - 1]] * inverse[(count - 1) * count + row];
    q[row] = even + odd;
  }
  if (before >= 0)
    for (int n = 0; n < count; ++n) p[n] = p_from[n] - alpha * dq[n];
  for (int n = first * NZ * NX; n < (first + planes) * NZ * NX; ++n)
    field[n] = slots[n] >= 0 ? -q[slots[n]] : 0;
  for (int n = first; n < first + planes; n += PLANES)
    forward_of(field + n * NZ * NX, spectrum + n * 2 * PART, roots, min(PLANES, first + planes - n));
}
