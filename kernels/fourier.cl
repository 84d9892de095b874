// Real two-dimensional Fourier transforms of planes, on processors (GPUs: fourier_groups.cl). One item a
// plane, or so many flat ones that their rows fill a vector: rows first, WIDTH at a time, each as HALF
// complex numbers; then columns, WIDTH at a time, in place. Column 0 meanwhile holds what columns 0 and HALF
// of the spectrum come from, as its parts: both are transforms of real numbers along z.
//
// Layouts: service/solver/fourier.h. The inverse is the same with parts exchanged. Buffers of an item hold
// complex numbers of WIDTH lanes, part next to part.
#include "fourier.clh"
#include "wide.clh"

// A vector anywhere in an array of numbers. What vstore16 is on PoCL stores four times.
typedef vec Loose __attribute__((aligned(TELETACT_DOUBLE ? 8 : 4)));
// Sizes are known within every function: a third of the time.
#define INLINE __attribute__((always_inline))
#define PLANES (WIDTH > NZ ? WIDTH / NZ : 1)  // of an item
#define ROOM (2 * (HALF > NZ ? HALF : NZ))

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

// A stage of Stockham's transform of span x done numbers: those before it transformed `done` at a time, this
// one RADIX times so many.
#define STAGE(RADIX)                                                                                      \
  INLINE void stage##RADIX(const vec* from, vec* to, const int exchanged, const int span, const int done, \
                           global const real* restrict roots) {                                           \
    const int re = exchanged, im = 1 - exchanged;                                                         \
    for (int p = 0; p < span / RADIX; ++p)                                                                \
      for (int q = 0; q < done; ++q) {                                                                    \
        vec r[RADIX], i[RADIX];                                                                           \
        _Pragma("unroll") for (int j = 0; j < RADIX; ++j) {                                               \
          const int n = q + done * (p + j * (span / RADIX));                                              \
          r[j] = from[2 * n + re];                                                                        \
          i[j] = from[2 * n + im];                                                                        \
        }                                                                                                 \
        butterfly##RADIX(r, i);                                                                           \
        _Pragma("unroll") for (int j = 0; j < RADIX; ++j) {                                               \
          const int n = q + done * (RADIX * p + j), root = 2 * (ROOTS / span) * j * p;                    \
          const bool turn = j > 0 && span > RADIX;                                                        \
          to[2 * n + re] = turn ? r[j] * roots[root] - i[j] * roots[root + 1] : r[j];                     \
          to[2 * n + im] = turn ? r[j] * roots[root + 1] + i[j] * roots[root] : i[j];                     \
        }                                                                                                 \
      }                                                                                                   \
  }
STAGE(2)
STAGE(4)
STAGE(8)

INLINE void stage(const vec* from, vec* to, const int exchanged, const int radix, const int span,
                  const int done, global const real* restrict roots) {
  if (radix == 2) stage2(from, to, exchanged, span, done, roots);
  if (radix == 4) stage4(from, to, exchanged, span, done, roots);
  if (radix == 8) stage8(from, to, exchanged, span, done, roots);
}

// Of `length` numbers in a, by at most three stages; b is as much room. Where the result is: a or b.
INLINE vec* transform(vec* a, vec* b, const int exchanged, const int length,
                      global const real* restrict roots) {
  const int first = length == 16 ? 4 : min(length, 8), rest = length / first;
  const int second = rest == 16 ? 4 : min(rest, 8), third = rest / second;
  stage(a, b, exchanged, first, length, 1, roots);
  stage(b, a, exchanged, second, rest, first, roots);
  stage(a, b, exchanged, third, third, first * second, roots);
  return third > 1 || (first > 1 && second == 1) ? b : a;
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
INLINE void rows_forward(global const real* restrict field, global real* restrict spectrum, const int r,
                         const int rows, vec* a, vec* b, global const real* restrict roots) {
  vec v[WIDTH];
  for (int x = 0; x < NX; x += WIDTH) {
#pragma unroll
    for (int i = 0; i < WIDTH; ++i)
      v[i] = *(global const Loose*)(field + (PLANES == 1 ? r + i : min(r + i, rows - 1)) * NX + x);
    transpose(v);
#pragma unroll
    for (int i = 0; i < WIDTH; ++i) a[x + i] = v[i];
  }
  vec* z = transform(a, b, 0, HALF, roots);
  const vec first = z[0];
  z[0] = first + z[1];
  z[1] = first - z[1];
  for (int k = 1; k <= HALF / 2; ++k) {
    vec *at = z + 2 * k, *mirror = z + 2 * (HALF - k);
    const real c = roots[2 * (ROOTS / NX) * k], s = roots[2 * (ROOTS / NX) * k + 1];
    const vec er = REAL(0.5) * (at[0] + mirror[0]), ei = REAL(0.5) * (at[1] - mirror[1]);
    const vec odd_r = REAL(0.5) * (at[1] + mirror[1]), odd_i = REAL(0.5) * (mirror[0] - at[0]);
    const vec tr = odd_r * c - odd_i * s, ti = odd_r * s + odd_i * c;
    mirror[0] = er - tr;
    mirror[1] = ti - ei;
    at[0] = er + tr;
    at[1] = ei + ti;
  }
  for (int k = 0; k < HALF; k += WIDTH)
    for (int part = 0; part < 2; ++part) {
#pragma unroll
      for (int i = 0; i < WIDTH; ++i) v[i] = z[2 * (k + i) + part];
      transpose(v);
#pragma unroll
      for (int i = 0; i < WIDTH; ++i)
        if (PLANES == 1 || r + i < rows)
          *(global Loose*)(spectrum + row_place(r + i) + part * PART + k) = v[i];
    }
}

INLINE void rows_backward(global const real* restrict spectrum, global real* restrict field, const int r,
                          const int rows, vec* a, vec* b, global const real* restrict roots) {
  vec v[WIDTH];
  for (int k = 0; k < HALF; k += WIDTH)
    for (int part = 0; part < 2; ++part) {
#pragma unroll
      for (int i = 0; i < WIDTH; ++i) {
        const int row = PLANES == 1 ? r + i : min(r + i, rows - 1);
        v[i] = *(global const Loose*)(spectrum + row_place(row) + part * PART + k);
      }
      transpose(v);
#pragma unroll
      for (int i = 0; i < WIDTH; ++i) a[2 * (k + i) + part] = v[i];
    }
  const real scale = REAL(1.0) / (NX * NZ);
  const vec first = scale * a[0], last = scale * a[1];
  a[0] = first + last;
  a[1] = first - last;
  for (int k = 1; k <= HALF / 2; ++k) {
    vec *at = a + 2 * k, *mirror = a + 2 * (HALF - k);
    const real c = scale * roots[2 * (ROOTS / NX) * k], s = scale * roots[2 * (ROOTS / NX) * k + 1];
    const vec er = scale * (at[0] + mirror[0]), ei = scale * (at[1] - mirror[1]);
    const vec dr = at[0] - mirror[0], di = at[1] + mirror[1];
    const vec tr = dr * s - di * c, ti = dr * c + di * s;  // i conj(root) d
    mirror[0] = er - tr;
    mirror[1] = ti - ei;
    at[0] = er + tr;
    at[1] = ei + ti;
  }
  const vec* z = transform(a, b, 1, HALF, roots);
  for (int x = 0; x < NX; x += WIDTH) {
#pragma unroll
    for (int i = 0; i < WIDTH; ++i) v[i] = z[x + i];
    transpose(v);
#pragma unroll
    for (int i = 0; i < WIDTH; ++i)
      if (PLANES == 1 || r + i < rows) *(global Loose*)(field + (r + i) * NX + x) = v[i];
  }
}

// Columns of a plane but the last, in place.
INLINE void columns(global real* restrict plane, const int exchanged, vec* a, vec* b,
                    global const real* restrict roots) {
  for (int k = 0; k < HALF; k += WIDTH) {
    for (int n = 0; n < NZ; ++n) {
      a[2 * n] = *(global const Loose*)(plane + n * PITCH + k);
      a[2 * n + 1] = *(global const Loose*)(plane + PART + n * PITCH + k);
    }
    const vec* z = transform(a, b, exchanged, NZ, roots);
    for (int n = 0; n < NZ; ++n) {
      *(global Loose*)(plane + n * PITCH + k) = z[2 * n];
      *(global Loose*)(plane + PART + n * PITCH + k) = z[2 * n + 1];
    }
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
  vec a[ROOM], b[ROOM];
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
  vec a[ROOM], b[ROOM];
  field += (size_t)(first + done) * NZ * NX;
  spectrum += (size_t)(first + done) * 2 * PART;
  for (int p = 0; p < planes; ++p) {
    join_columns(spectrum + p * 2 * PART);
    columns(spectrum + p * 2 * PART, 1, a, b, roots);
  }
  for (int r = 0; r < planes * NZ; r += WIDTH) rows_backward(spectrum, field, r, planes * NZ, a, b, roots);
}
