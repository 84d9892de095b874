// Fourier transforms of planes on GPUs: fourier_lines.clh.
#include "fourier_lines.clh"

// Rows of `count` planes from `first` on.
kernel __attribute__((reqd_work_group_size(GROUP, 1, 1))) void rows_forward(global const real* restrict field,
                                                                            global real* restrict spectrum,
                                                                            global const real* restrict roots,
                                                                            const int first,
                                                                            const int count) {
  local real re[4 * GROUP], im[4 * GROUP];
  rows_forward_of(field + (size_t)first * NZ * NX, spectrum + (size_t)first * 2 * PART, roots,
                  ROWS * OWN_GROUP, count * NZ, re, im);
}

kernel __attribute__((reqd_work_group_size(GROUP, 1, 1))) void rows_backward(
    global const real* restrict spectrum, global real* restrict field, global const real* restrict roots,
    const int first, const int count) {
  local real re[4 * GROUP], im[4 * GROUP];
  rows_backward_of(spectrum + (size_t)first * 2 * PART, field + (size_t)first * NZ * NX, roots,
                   ROWS * OWN_GROUP, count * NZ, re, im);
}

// Columns of planes from `first` on, in place. Groups: (columns, plane).
kernel __attribute__((reqd_work_group_size(GROUP, 1, 1))) void columns(global real* restrict spectrum,
                                                                       global const real* restrict roots,
                                                                       const int first, const int exchanged) {
  local real re[4 * GROUP], im[4 * GROUP];
  columns_of(spectrum + (size_t)(first + (int)get_global_id(1)) * 2 * PART, roots, COLUMNS * OWN_GROUP,
             exchanged, re, im);
}
