// Conjugate gradients on solid tissue (solid.cl) joined with Fourier transforms, on GPUs: work-groups as of
// fourier_groups.cl. Processors launch the parts one after the other: each pair of sizes would have PoCL
// compile all of them for 20 s, instead of the transforms alone for 7 s.
#include "fourier_lines.clh"
#include "solid_marks.clh"

// solid_step where there was an iteration before (before >= 0), and the transform of r: rows alone.
kernel __attribute__((reqd_work_group_size(GROUP, 1, 1))) void step_forward(
    global const real* restrict d, global const real* restrict kd, global const real* u_from, global real* u,
    global const real* r_from, global real* r, global const accum* restrict curvature,
    global real* restrict marks, global real* restrict spectrum, global const real* restrict roots,
    const int count, const int parts, const int before) {
  local real re[4 * GROUP], im[4 * GROUP];
  const int begin = ROWS * OWN_GROUP, rows = count * NZ;
  if (before >= 0) {
    const real alpha = step_length(marks, curvature, parts, before, re);
    for (int n = begin * NX + get_local_id(0); n < min(begin + ROWS, rows) * NX; n += GROUP) {
      u[n] = u_from[n] + alpha * d[n];
      r[n] = r_from[n] - alpha * kd[n];
    }
    barrier(CLK_LOCAL_MEM_FENCE);                              // `re` is used again
    rows_forward_of(r, spectrum, roots, begin, rows, re, im);  // each item reads what it wrote
  } else {
    rows_forward_of(r_from, spectrum, roots, begin, rows, re, im);
  }
}

// The transform back to z, rows alone, and partial sums of r . z, one of each group.
kernel __attribute__((reqd_work_group_size(GROUP, 1, 1))) void backward_dot(
    global real* restrict spectrum, global real* restrict z, global const real* restrict r,
    global real* restrict marks, global const real* restrict roots, const int count) {
  local real re[4 * GROUP], im[4 * GROUP];
  const int begin = ROWS * OWN_GROUP, rows = count * NZ;
  rows_backward_of(spectrum, z, roots, begin, rows, re, im);
  real sum = 0;
  for (int n = begin * NX + get_local_id(0); n < min(begin + ROWS, rows) * NX; n += GROUP) sum += z[n] * r[n];
  barrier(CLK_LOCAL_MEM_FENCE);
  sum = sum_of_group(sum, re);
  if (get_local_id(0) == 0) marks[PARTS + OWN_GROUP] = sum;
}

// Between the sweeps, planes first .. first + planes - 1 of the surface: how it would move, back from its
// spectra; patch_project; -B^T q, and its spectra. M is symmetric: q is the sum of its rows times B's
// numbers. One group.
kernel __attribute__((reqd_work_group_size(GROUP, 1, 1))) void patch_surface(
    global real* restrict spectrum, global real* restrict field, global const real* restrict roots,
    global const real* restrict inverse, global const int* restrict unknowns,
    global const int* restrict slots, global real* restrict q, global const real* restrict dq,
    global const real* p_from, global real* p, global const real* restrict marks, const int first,
    const int planes, const int count, const int before) {
  local real re[4 * GROUP], im[4 * GROUP];
  const int item = get_local_id(0), rows = planes * NZ;
  spectrum += first * 2 * PART;
  for (int plane = 0; plane < planes; ++plane)
    for (int begin = 0; begin <= HALF; begin += COLUMNS) {
      columns_of(spectrum + plane * 2 * PART, roots, begin, 1, re, im);
      barrier(CLK_LOCAL_MEM_FENCE | CLK_GLOBAL_MEM_FENCE);
    }
  for (int begin = 0; begin < rows; begin += ROWS) {
    rows_backward_of(spectrum, field + first * NZ * NX, roots, begin, rows, re, im);
    barrier(CLK_LOCAL_MEM_FENCE | CLK_GLOBAL_MEM_FENCE);
  }
  const real alpha = before < 0 ? 0 : marks[MARKS_OF_ITERATION * before + ALPHA];
  for (int row = item; row < count; row += GROUP) {
    real even = 0, odd = 0;
    int n = 0;
    for (; n + 2 <= count; n += 2) {
      even += inverse[n * count + row] * field[unknowns[n]];
      odd += inverse[(n + 1) * count + row] * field[unknowns[n + 1]];
    }
    if (n < count) even += inverse[n * count + row] * field[unknowns[n]];
    q[row] = even + odd;
    if (before >= 0) p[row] = p_from[row] - alpha * dq[row];
  }
  barrier(CLK_GLOBAL_MEM_FENCE);
  for (int n = first * NZ * NX + item; n < (first + planes) * NZ * NX; n += GROUP)
    field[n] = slots[n] >= 0 ? -q[slots[n]] : 0;
  barrier(CLK_GLOBAL_MEM_FENCE);
  for (int begin = 0; begin < rows; begin += ROWS) {
    rows_forward_of(field + first * NZ * NX, spectrum, roots, begin, rows, re, im);
    barrier(CLK_LOCAL_MEM_FENCE | CLK_GLOBAL_MEM_FENCE);
  }
  for (int plane = 0; plane < planes; ++plane)
    for (int begin = 0; begin <= HALF; begin += COLUMNS) {
      columns_of(spectrum + plane * 2 * PART, roots, begin, 0, re, im);
      barrier(CLK_LOCAL_MEM_FENCE | CLK_GLOBAL_MEM_FENCE);
    }
}
