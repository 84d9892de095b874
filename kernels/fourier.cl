// Fourier transforms of planes on processors: fourier_items.clh.
#include "fourier_items.clh"

kernel void forward(global const real* restrict field, global real* restrict spectrum,
                    global const real* restrict roots, const int first, const int count) {
  const int done = PLANES * get_global_id(0), planes = min(count - done, PLANES);
  if (planes <= 0) return;
  forward_of(field + (size_t)(first + done) * NZ * NX, spectrum + (size_t)(first + done) * 2 * PART, roots,
             planes);
}

kernel void backward(global real* restrict spectrum, global real* restrict field,
                     global const real* restrict roots, const int first, const int count) {
  const int done = PLANES * get_global_id(0), planes = min(count - done, PLANES);
  if (planes <= 0) return;
  backward_of(spectrum + (size_t)(first + done) * 2 * PART, field + (size_t)(first + done) * NZ * NX, roots,
              planes);
}
