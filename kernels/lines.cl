// Multigrid's smoother for stretched elements: the operator restricted to the nodes of one row (or column) of
// cells, two nodes wide, solved exactly along its length. Block tridiagonal with blocks of 4: at each step
// S_s = D_s - E_(s-1)^T G_(s-1), G_s = S_s^-1 E_s. Lines run along x (along_x = 1) or along y; line l is of
// nodes l and l + 1 across. factor: [step][S^-1 4 x 4, G 4 x 4][line].
#include "levels.clh"

#define FACTOR 32

real4 row_of(global const real* restrict factor, const int row, const int lines) {
  global const real* f = factor + 4 * row * lines;
  return (real4)(f[0], f[lines], f[2 * lines], f[3 * lines]);
}

// In-place inverse of a symmetric positive definite matrix by the sweep operator (Goodnight 1979); false when
// it is not.
bool invert_4(real m[4][4]) {
  bool definite = true;
  for (int k = 0; k < 4; ++k) {
    definite = definite && m[k][k] > 0;
    const real pivot = 1 / m[k][k];
    for (int row = 0; row < 4; ++row)
      for (int column = 0; column < 4; ++column)
        m[row][column] -= row == k || column == k ? 0 : m[row][k] * pivot * m[k][column];
    for (int n = 0; n < 4; ++n) {
      m[n][k] *= n == k ? 1 : pivot;
      m[k][n] *= n == k ? 1 : pivot;
    }
    m[k][k] = -pivot;
  }
  for (int n = 0; n < 16; ++n) m[n / 4][n % 4] = -m[n / 4][n % 4];
  return definite;
}

// Blocks that couple the two nodes at `node` with the two `to` away in k. across: (nodes, k) from one node of
// a line to the other.
void load_4(real m[4][4], global const real4* restrict a, const int node, const int to, const int2 across,
            const int nodes) {
  for (int p = 0; p < 2; ++p)
    for (int q = 0; q < 2; ++q) {
      const real4 block = a[(4 + to + (q - p) * across.y) * nodes + node + p * across.x];
      m[2 * p][2 * q] = block.x;
      m[2 * p][2 * q + 1] = block.y;
      m[2 * p + 1][2 * q] = block.z;
      m[2 * p + 1][2 * q + 1] = block.w;
    }
}

// Items: lines. `indefinite` is set to 1 where a line is not positive definite. About 500 flops per step.
kernel void factor_lines(global const real4* restrict a, global real* restrict factor,
                         global int* restrict indefinite, const int nx, const int ny, const int along_x) {
  const int line = get_global_id(0), steps = along_x ? nx : ny, lines = (along_x ? ny : nx) - 1;
  if (line >= lines) return;
  const int2 along = along_x ? (int2)(1, 1) : (int2)(nx, 3), across = along_x ? (int2)(nx, 3) : (int2)(1, 1);
  real s[4][4], e[4][4], g[4][4];
  for (int step = 0; step < steps; ++step) {
    const int node = step * along.x + line * across.x;
    load_4(s, a, node, 0, across, nx * ny);
    for (int n = 0; step > 0 && n < 16; ++n)
      for (int m = 0; m < 4; ++m) s[n / 4][n % 4] -= e[m][n / 4] * g[m][n % 4];
    if (!invert_4(s)) *indefinite = 1;
    load_4(e, a, node, along.y, across, nx * ny);  // zero at the end of the line
    global real* out = factor + step * FACTOR * lines + line;
    for (int n = 0; n < 16; ++n) {
      real sum = 0;
      for (int m = 0; m < 4; ++m) sum += s[n / 4][m] * e[m][n % 4];
      g[n / 4][n % 4] = sum;
      out[n * lines] = s[n / 4][n % 4];
      out[(16 + n) * lines] = sum;
    }
  }
}

// Solves every line for the level's residual (from_zero: right-hand side), the others' unknowns zero. x:
// [right-hand side][step][4][line]. Items: (line, right-hand side). Reads 48 + 8 and writes 8 reals per step,
// about 110 flops.
kernel void solve_lines(global const real* restrict factor, global const real* restrict vectors,
                        global real* restrict x, global const int* restrict table, const int index,
                        const int vectors_size, const int along_x, const int from_zero) {
  const Level level = level_of(table, index);
  const int line = get_global_id(0), q = get_global_id(1);
  const int steps = along_x ? level.nx : level.ny, lines = (along_x ? level.ny : level.nx) - 1;
  if (line >= lines) return;
  const int along = along_x ? 1 : level.pitch, across = along_x ? level.pitch : 1, stride = level.stride;
  global const real* from = vectors + q * vectors_size + level.vectors +
                            (from_zero ? RIGHT : RESIDUAL) * stride + first_node(level) + line * across;
  global const real* f = factor + line;
  global real* out = x + q * 4 * steps * lines + line;
  real4 y = (real4)(0);
  for (int step = 0; step < steps; ++step) {
    global const real* r = from + step * along;
    real4 now = (real4)(r[0], r[stride], r[across], r[stride + across]);
    if (step > 0) {
      global const real* g = f + (FACTOR * (step - 1) + 16) * lines;
      now -= y.x * row_of(g, 0, lines) + y.y * row_of(g, 1, lines) + y.z * row_of(g, 2, lines) +
             y.w * row_of(g, 3, lines);
    }
    y = now;
    for (int c = 0; c < 4; ++c) out[(4 * step + c) * lines] = y[c];
  }
  real4 last = (real4)(0);
  for (int step = steps - 1; step >= 0; --step) {
    global const real* s = f + FACTOR * step * lines;
    global real* at = out + 4 * step * lines;
    const real4 now = row_of(at, 0, lines);
    last = (real4)(dot(row_of(s, 0, lines), now) - dot(row_of(s, 4, lines), last),
                   dot(row_of(s, 1, lines), now) - dot(row_of(s, 5, lines), last),
                   dot(row_of(s, 2, lines), now) - dot(row_of(s, 6, lines), last),
                   dot(row_of(s, 3, lines), now) - dot(row_of(s, 7, lines), last));
    for (int c = 0; c < 4; ++c) at[c * lines] = last[c];
  }
}

// Chebyshev step k: d = c_old d + c_new (sum of the two lines through a node), correction += d; from_zero:
// correction = d. Items: (i, j, right-hand side).
kernel void line_step(global const real* restrict constants, global const real* restrict x,
                      global real* restrict vectors, global const int* restrict table, const int index,
                      const int vectors_size, const int along_x, const int k, const int from_zero) {
  const Level level = level_of(table, index);
  const int i = get_global_id(0), j = get_global_id(1), q = get_global_id(2);
  if (i >= level.nx || j >= level.ny) return;
  const int step = along_x ? i : j, line = along_x ? j : i;
  const int steps = along_x ? level.nx : level.ny, lines = (along_x ? level.ny : level.nx) - 1;
  global const real* from = x + 4 * (q * steps + step) * lines + line;
  real2 sum = (real2)(0);
  if (line < lines) sum += (real2)(from[0], from[lines]);
  if (line > 0) sum += (real2)(from[2 * lines - 1], from[3 * lines - 1]);
  const int stride = level.stride;
  global real* at = vectors + q * vectors_size + level.vectors + first_node(level) + i + level.pitch * j;
  global real* d = at + DIRECTION * stride;
  global real* z = at + CORRECTION * stride;
  real2 now = constants[2 * k + 1] * sum;
  if (k > 0) now += constants[2 * k] * (real2)(d[0], d[stride]);
  d[0] = now.x;
  d[stride] = now.y;
  z[0] = from_zero ? now.x : z[0] + now.x;
  z[stride] = from_zero ? now.y : z[stride] + now.y;
}
