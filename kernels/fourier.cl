// Real two-dimensional Fourier transforms of planes, on processors (GPUs: fourier_groups.cl). One item a
// plane, or so many flat ones that their rows fill a vector: rows first, WIDTH at a time, each as NX / 2
// complex numbers; then columns, WIDTH at a time, in place. Column 0 meanwhile holds what columns 0 and NX /
// 2 of the spectrum come from, as its parts: both are transforms of real numbers along z.
//
// Layouts: service/solver/fourier.h. The inverse is the same with parts exchanged. Buffers of an item hold
// complex numbers of WIDTH lanes, part next to part.
#include "fourier.clh"
#include "wide.clh"

#define PLANES (WIDTH > NZ ? WIDTH / NZ : 1)  // of an item
#define ROOM (2 * WIDTH * (HALF > NZ ? HALF : NZ))

void butterfly2(vec* re, vec* im) {
  const vec r = re[0] - re[1], i = im[0] - im[1];
  re[0] += re[1];
  im[0] += im[1];
  re[1] = r;
  im[1] = i;
}

// Of elements 0, step, 2 step, 3 step.
void butterfly4_of(vec* re, vec* im, const int step) {
  const vec ar = re[0] + re[2 * step], ai = im[0] + im[2 * step];
  const vec br = re[0] - re[2 * step], bi = im[0] - im[2 * step];
  const vec cr = re[step] + re[3 * step], ci = im[step] + im[3 * step];
  const vec dr = re[step] - re[3 * step], di = im[step] - im[3 * step];
  re[0] = ar + cr;
  im[0] = ai + ci;
  re[step] = br + di;
  im[step] = bi - dr;
  re[2 * step] = ar - cr;
  im[2 * step] = ai - ci;
  re[3 * step] = br - di;
  im[3 * step] = bi + dr;
}

void butterfly4(vec* re, vec* im) {
  butterfly4_of(re, im, 1);
}

void butterfly8(vec* re, vec* im) {
  const real c = REAL(0.70710678118654752440);
  butterfly4_of(re, im, 2);
  butterfly4_of(re + 1, im + 1, 2);
  const vec r1 = c * (re[3] + im[3]), i1 = c * (im[3] - re[3]);
  const vec r2 = im[5], i2 = -re[5];
  const vec r3 = c * (im[7] - re[7]), i3 = -c * (re[7] + im[7]);
  const vec even_r[4] = {re[0], re[2], re[4], re[6]}, even_i[4] = {im[0], im[2], im[4], im[6]};
  const vec odd_r[4] = {re[1], r1, r2, r3}, odd_i[4] = {im[1], i1, i2, i3};
#pragma unroll
  for (int j = 0; j < 4; ++j) {
    re[j] = even_r[j] + odd_r[j];
    im[j] = even_i[j] + odd_i[j];
    re[j + 4] = even_r[j] - odd_r[j];
    im[j + 4] = even_i[j] - odd_i[j];
  }
}

// A stage of Stockham's transform: `span` of what is still to be transformed, done in `done` places.
#define STAGE(RADIX)                                                                                   \
  void stage##RADIX(const real* from, real* to, const int exchanged, const int span, const int done,   \
                    global const real* restrict roots) {                                               \
    const int re = exchanged ? WIDTH : 0, im = WIDTH - re;                                             \
    for (int p = 0; p < span / RADIX; ++p)                                                             \
      for (int q = 0; q < done; ++q) {                                                                 \
        vec r[RADIX], i[RADIX];                                                                        \
        _Pragma("unroll") for (int j = 0; j < RADIX; ++j) {                                            \
          const real* at = from + 2 * WIDTH * (q + done * (p + j * (span / RADIX)));                   \
          r[j] = LOAD(at + re);                                                                        \
          i[j] = LOAD(at + im);                                                                        \
        }                                                                                              \
        butterfly##RADIX(r, i);                                                                        \
        _Pragma("unroll") for (int j = 0; j < RADIX; ++j) {                                            \
          const real c = roots[2 * (ROOTS / span) * j * p], s = roots[2 * (ROOTS / span) * j * p + 1]; \
          real* at = to + 2 * WIDTH * (q + done * (RADIX * p + j));                                    \
          STORE(j == 0 || span == RADIX ? r[j] : r[j] * c - i[j] * s, at + re);                        \
          STORE(j == 0 || span == RADIX ? i[j] : r[j] * s + i[j] * c, at + im);                        \
        }                                                                                              \
      }                                                                                                \
  }
STAGE(2)
STAGE(4)
STAGE(8)
#undef STAGE

// Of `length` numbers in a; b is as much room. Where the result is: a or b.
real* transform(real* a, real* b, const int exchanged, const int length, global const real* restrict roots) {
  int span = length, done = 1;
  while (span > 1) {
    const int radix = span == 16 ? 4 : min(span, 8);
    if (radix == 8) stage8(a, b, exchanged, span, done, roots);
    if (radix == 4) stage4(a, b, exchanged, span, done, roots);
    if (radix == 2) stage2(a, b, exchanged, span, done, roots);
    span /= radix;
    done *= radix;
    real* last = a;
    a = b;
    b = last;
  }
  return a;
}

// Lane j of vector i goes to lane i of vector j.
void transpose(vec* v) {
#if WIDTH > 1
#pragma unroll
  for (int step = 1; step < WIDTH; step *= 2) {
    vec t[WIDTH];
#pragma unroll
    for (int i = 0; i < WIDTH / 2; ++i) {
      t[2 * i].even = v[i].lo;
      t[2 * i].odd = v[i + WIDTH / 2].lo;
      t[2 * i + 1].even = v[i].hi;
      t[2 * i + 1].odd = v[i + WIDTH / 2].hi;
    }
#pragma unroll
    for (int i = 0; i < WIDTH; ++i) v[i] = t[i];
  }
#endif
}

// Row r of the item's planes in their spectrum.
int row_place(const int r) {
  return r / NZ * 2 * PART + r % NZ * PITCH;
}

// Rows r to r + WIDTH - 1 of an item's field, of which `rows` exist.
void rows_forward(global const real* restrict field, global real* restrict spectrum, const int r,
                  const int rows, real* a, real* b, global const real* restrict roots) {
  vec v[WIDTH];
  for (int x = 0; x < NX; x += WIDTH) {
#pragma unroll
    for (int i = 0; i < WIDTH; ++i) v[i] = LOAD(field + min(r + i, rows - 1) * NX + x);
    transpose(v);
#pragma unroll
    for (int i = 0; i < WIDTH; ++i) STORE(v[i], a + (x + i) * WIDTH);
  }
  real* z = transform(a, b, 0, HALF, roots);
  const vec first = LOAD(z);
  STORE(first + LOAD(z + WIDTH), z);
  STORE(first - LOAD(z + WIDTH), z + WIDTH);
  for (int k = 1; k <= HALF / 2; ++k) {
    real *at = z + 2 * WIDTH * k, *mirror = z + 2 * WIDTH * (HALF - k);
    const real c = roots[2 * (ROOTS / NX) * k], s = roots[2 * (ROOTS / NX) * k + 1];
    const vec zr = LOAD(at), zi = LOAD(at + WIDTH), mr = LOAD(mirror), mi = LOAD(mirror + WIDTH);
    const vec er = REAL(0.5) * (zr + mr), ei = REAL(0.5) * (zi - mi);
    const vec odd_r = REAL(0.5) * (zi + mi), odd_i = REAL(0.5) * (mr - zr);
    const vec tr = odd_r * c - odd_i * s, ti = odd_r * s + odd_i * c;
    STORE(er - tr, mirror);
    STORE(ti - ei, mirror + WIDTH);
    STORE(er + tr, at);
    STORE(ei + ti, at + WIDTH);
  }
  for (int k = 0; k < HALF; k += WIDTH)
#pragma unroll
    for (int part = 0; part < 2; ++part) {
#pragma unroll
      for (int i = 0; i < WIDTH; ++i) v[i] = LOAD(z + (2 * (k + i) + part) * WIDTH);
      transpose(v);
#pragma unroll
      for (int i = 0; i < WIDTH; ++i)
        if (PLANES == 1 || r + i < rows) STORE(v[i], spectrum + row_place(r + i) + part * PART + k);
    }
}

void rows_backward(global const real* restrict spectrum, global real* restrict field, const int r,
                   const int rows, real* a, real* b, global const real* restrict roots) {
  vec v[WIDTH];
  for (int k = 0; k < HALF; k += WIDTH)
#pragma unroll
    for (int part = 0; part < 2; ++part) {
#pragma unroll
      for (int i = 0; i < WIDTH; ++i)
        v[i] = LOAD(spectrum + row_place(min(r + i, rows - 1)) + part * PART + k);
      transpose(v);
#pragma unroll
      for (int i = 0; i < WIDTH; ++i) STORE(v[i], a + (2 * (k + i) + part) * WIDTH);
    }
  const real scale = REAL(1.0) / (NX * NZ);
  const vec first = scale * LOAD(a), last = scale * LOAD(a + WIDTH);
  STORE(first + last, a);
  STORE(first - last, a + WIDTH);
  for (int k = 1; k <= HALF / 2; ++k) {
    real *at = a + 2 * WIDTH * k, *mirror = a + 2 * WIDTH * (HALF - k);
    const real c = scale * roots[2 * (ROOTS / NX) * k], s = scale * roots[2 * (ROOTS / NX) * k + 1];
    const vec xr = LOAD(at), xi = LOAD(at + WIDTH), mr = LOAD(mirror), mi = LOAD(mirror + WIDTH);
    const vec er = scale * (xr + mr), ei = scale * (xi - mi);
    const vec dr = xr - mr, di = xi + mi;
    const vec tr = dr * s - di * c, ti = dr * c + di * s;  // i conj(root) d
    STORE(er - tr, mirror);
    STORE(ti - ei, mirror + WIDTH);
    STORE(er + tr, at);
    STORE(ei + ti, at + WIDTH);
  }
  const real* z = transform(a, b, 1, HALF, roots);
  for (int x = 0; x < NX; x += WIDTH) {
#pragma unroll
    for (int i = 0; i < WIDTH; ++i) v[i] = LOAD(z + (x + i) * WIDTH);
    transpose(v);
#pragma unroll
    for (int i = 0; i < WIDTH; ++i)
      if (PLANES == 1 || r + i < rows) STORE(v[i], field + (r + i) * NX + x);
  }
}

// Columns of a plane but the last, in place.
void columns(global real* restrict plane, const int exchanged, real* a, real* b,
             global const real* restrict roots) {
  for (int k = 0; k < HALF; k += WIDTH) {
    for (int n = 0; n < NZ; ++n)
#pragma unroll
      for (int part = 0; part < 2; ++part)
        STORE(LOAD(plane + part * PART + n * PITCH + k), a + (2 * n + part) * WIDTH);
    const real* z = transform(a, b, exchanged, NZ, roots);
    for (int n = 0; n < NZ; ++n)
#pragma unroll
      for (int part = 0; part < 2; ++part)
        STORE(LOAD(z + (2 * n + part) * WIDTH), plane + part * PART + n * PITCH + k);
  }
}

// Column 0 into columns 0 and HALF, and zeros beyond.
void split_columns(global real* plane) {
  for (int n = 0; n < NZ; ++n)
    for (int k = HALF; k < PITCH; ++k) plane[n * PITCH + k] = plane[PART + n * PITCH + k] = 0;
  for (int n = 0; n <= NZ / 2; ++n) {
    global real *re = plane + n * PITCH, *mirror = plane + (NZ - n) % NZ * PITCH;
    global real *im = re + PART, *mirror_im = mirror + PART;
    const real ar = REAL(0.5) * (*re + *mirror), ai = REAL(0.5) * (*im - *mirror_im);
    const real br = REAL(0.5) * (*im + *mirror_im), bi = REAL(0.5) * (*mirror - *re);
    re[0] = mirror[0] = ar;
    re[HALF] = mirror[HALF] = br;
    mirror_im[0] = -ai;
    mirror_im[HALF] = -bi;
    im[0] = ai;
    im[HALF] = bi;
  }
}

void join_columns(global real* plane) {
  for (int n = 0; n < NZ; ++n) {
    global real *re = plane + n * PITCH, *im = re + PART;
    *re -= im[HALF];
    *im += re[HALF];
  }
}

kernel void forward(global const real* restrict field, global real* restrict spectrum,
                    global const real* restrict roots, const int first, const int count) {
  const int done = PLANES * get_global_id(0), planes = min(count - done, PLANES);
  if (planes <= 0) return;
  real a[ROOM], b[ROOM];
  field += (size_t)(first + done) * NZ * NX;
  spectrum += (size_t)(first + done) * 2 * PART;
  for (int r = 0; r < planes * NZ; r += WIDTH) rows_forward(field, spectrum, r, planes * NZ, a, b, roots);
  for (int p = 0; p < planes; ++p) {
    columns(spectrum + p * 2 * PART, 0, a, b, roots);
    split_columns(spectrum + p * 2 * PART);
  }
}

// The spectrum is used up.
kernel void backward(global real* restrict spectrum, global real* restrict field,
                     global const real* restrict roots, const int first, const int count) {
  const int done = PLANES * get_global_id(0), planes = min(count - done, PLANES);
  if (planes <= 0) return;
  real a[ROOM], b[ROOM];
  field += (size_t)(first + done) * NZ * NX;
  spectrum += (size_t)(first + done) * 2 * PART;
  for (int p = 0; p < planes; ++p) {
    join_columns(spectrum + p * 2 * PART);
    columns(spectrum + p * 2 * PART, 1, a, b, roots);
  }
  for (int r = 0; r < planes * NZ; r += WIDTH) rows_backward(spectrum, field, r, planes * NZ, a, b, roots);
}
