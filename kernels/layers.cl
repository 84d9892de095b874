// Layered tissue solved in Fourier space (T8.1; service/tissue/solid/layered_factor.h): along y, for WIDTH wave
// numbers kx at once. Spectra: [plane = 3 row + component][re, im][kz][pitch]. Between `layers_up` and
// `layers_down` a spectrum holds the eliminated right-hand sides in the blocks' own basis, in which u_y is
// multiplied with -i and, where kz stands for a negative wave number, u_z's sign is turned.
#include "wide.clh"

typedef struct {
  vec re[3], im[3];
} Complex3;

// Where the lanes of an item (group of lanes, kz) lie.
typedef struct {
  int at;     // in a part of a spectrum
  int of;     // in a plane of the factor: of |kz|
  real sign;  // of u_z in the blocks' basis
} Lanes;

Lanes lanes(const int group, const int kz, const int nz, const int pitch) {
  const bool negative = kz > nz / 2;
  Lanes l;
  l.at = kz * pitch + group * WIDTH;
  l.of = (negative ? nz - kz : kz) * pitch + group * WIDTH;
  l.sign = negative ? -1 : 1;
  return l;
}

// [plane of row 0][re] of the lanes; part: nz * pitch.
Complex3 load_row(global const real* spectrum, const int part) {
  Complex3 u;
  for (int c = 0; c < 3; ++c) {
    u.re[c] = LOAD(spectrum + 2 * c * part);
    u.im[c] = LOAD(spectrum + (2 * c + 1) * part);
  }
  return u;
}

void store_row(const Complex3 u, global real* spectrum, const int part) {
  for (int c = 0; c < 3; ++c) {
    STORE(u.re[c], spectrum + 2 * c * part);
    STORE(u.im[c], spectrum + (2 * c + 1) * part);
  }
}

// Into the basis in which the blocks are real, and back.
Complex3 into_basis(const Complex3 f, const real sign) {
  Complex3 g = f;
  g.re[1] = f.im[1];
  g.im[1] = -f.re[1];
  g.re[2] = sign * f.re[2];
  g.im[2] = sign * f.im[2];
  return g;
}

Complex3 out_of_basis(const Complex3 u, const real sign) {
  Complex3 v = u;
  v.re[1] = -u.im[1];
  v.im[1] = u.re[1];
  v.re[2] = sign * u.re[2];
  v.im[2] = sign * u.im[2];
  return v;
}

// S^-1 g, from its six planes.
Complex3 solve_block(global const real* inverse, const int plane, const Complex3 g) {
  const vec xx = LOAD(inverse), xy = LOAD(inverse + plane), xz = LOAD(inverse + 2 * plane);
  const vec yy = LOAD(inverse + 3 * plane), yz = LOAD(inverse + 4 * plane), zz = LOAD(inverse + 5 * plane);
  Complex3 u;
  u.re[0] = xx * g.re[0] + xy * g.re[1] + xz * g.re[2];
  u.im[0] = xx * g.im[0] + xy * g.im[1] + xz * g.im[2];
  u.re[1] = xy * g.re[0] + yy * g.re[1] + yz * g.re[2];
  u.im[1] = xy * g.im[0] + yy * g.im[1] + yz * g.im[2];
  u.re[2] = xz * g.re[0] + yz * g.re[1] + zz * g.re[2];
  u.im[2] = xz * g.im[0] + yz * g.im[1] + zz * g.im[2];
  return u;
}

// Eliminates from the bottom up, in place, and puts into `surface` how the free surface moves: its planes
// [first, first + count) of the components. Items: (group of lanes, kz), here and below.
kernel void layers_up(global const real* restrict inverse, global const real* restrict coupling,
                      global real* restrict spectrum, global real* restrict surface, const int layers,
                      const int nz, const int pitch, const int first, const int count) {
  const int group = get_global_id(0), kz = get_global_id(1);
  if (group * WIDTH >= pitch || kz >= nz) return;
  const int plane = (nz / 2 + 1) * pitch, part = nz * pitch;
  const Lanes l = lanes(group, kz, nz, pitch);
  global const real *s = inverse + l.of, *w = coupling + l.of;
  global real* row = spectrum + l.at;
  Complex3 below;
  for (int j = layers - 1; j >= 0; --j) {
    Complex3 g = into_basis(load_row(row + 6 * j * part, part), l.sign);
    if (j < layers - 1)
      for (int p = 0; p < 3; ++p)
        for (int q = 0; q < 3; ++q) {
          const vec c = LOAD(w + (9 * j + 3 * q + p) * plane);  // W^T
          g.re[p] -= c * below.re[q];
          g.im[p] -= c * below.im[q];
        }
    store_row(g, row + 6 * j * part, part);
    below = g;
  }
  const Complex3 u = out_of_basis(solve_block(s, plane, below), l.sign);
  global real* at = surface + l.at;
  for (int c = first; c < first + count; ++c) {
    STORE(u.re[c], at + 2 * c * part);
    STORE(u.im[c], at + (2 * c + 1) * part);
  }
}

// From the surface down: the displacement, in place. Forces on the surface are added to what was eliminated:
// the spectra in the planes [first, first + count) of `surface`.
kernel void layers_down(global const real* restrict inverse, global const real* restrict coupling,
                        global real* restrict spectrum, global const real* restrict surface, const int layers,
                        const int nz, const int pitch, const int first, const int count) {
  const int group = get_global_id(0), kz = get_global_id(1);
  if (group * WIDTH >= pitch || kz >= nz) return;
  const int plane = (nz / 2 + 1) * pitch, part = nz * pitch;
  const Lanes l = lanes(group, kz, nz, pitch);
  global const real *s = inverse + l.of, *w = coupling + l.of;
  global real* row = spectrum + l.at;
  global const real* at = surface + l.at;
  Complex3 force;
  for (int c = 0; c < 3; ++c) {
    const bool there = c >= first && c < first + count;
    force.re[c] = there ? LOAD(at + 2 * c * part) : (vec)(0);
    force.im[c] = there ? LOAD(at + (2 * c + 1) * part) : (vec)(0);
  }
  force = into_basis(force, l.sign);
  Complex3 above;
  for (int j = 0; j < layers; ++j) {
    Complex3 g = load_row(row + 6 * j * part, part);
    if (j == 0)
      for (int c = 0; c < 3; ++c) {
        g.re[c] += force.re[c];
        g.im[c] += force.im[c];
      }
    Complex3 u = solve_block(s + 6 * j * plane, plane, g);
    if (j > 0)
      for (int p = 0; p < 3; ++p)
        for (int q = 0; q < 3; ++q) {
          const vec c = LOAD(w + (9 * (j - 1) + 3 * p + q) * plane);
          u.re[p] -= c * above.re[q];
          u.im[p] -= c * above.im[q];
        }
    store_row(out_of_basis(u, l.sign), row + 6 * j * part, part);
    above = u;
  }
}
