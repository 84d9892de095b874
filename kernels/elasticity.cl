// Plane-strain linear elasticity on bilinear quadrilaterals of a rectilinear grid (T4): 2 mu eps:eps
// integrated exactly (2x2 Gauss points), lambda (div u)^2 at the element centre. On an a x b rectangle with r
// = b/a, nodes with signs s (x) and t (y) at the corners, the element matrix of nodes m, n is
//   xx: mu (2 r s s' M_tt' + t t' M_ss' / r) + lambda r s s' / 4      M = 1/3 (same sign) or 1/6
//   xy: mu t s' / 4 + lambda s t' / 4
//   yy: mu (2 t t' M_ss' / r + r s s' M_tt') + lambda t t' / (4 r)
// Node (i, j) = i + nx j, element (i, j) = i + (nx - 1) j. mu = mu_per_e E, lambda = lambda_per_e E.
#include "stencil.clh"
#include "wide.clh"

// Vectors at WIDTH nodes of a row of nx, from column `first` on; beyond its ends those at them.
Vec2 load_nodes(global const real* row, const int first, const int nx) {
  Vec2 u;
#if WIDTH > 1
  if (first >= 0 && first + WIDTH <= nx) {
    const vec a = LOAD(row + 2 * first), b = LOAD(row + 2 * first + WIDTH);
    u.x = (vec)(a.even, b.even);
    u.y = (vec)(a.odd, b.odd);
    return u;
  }
#endif
  real x[WIDTH], y[WIDTH];
  for (int lane = 0; lane < WIDTH; ++lane) {
    const int at = 2 * clamp(first + lane, 0, nx - 1);
    x[lane] = row[at];
    y[lane] = row[at + 1];
  }
  u.x = LOAD(x);
  u.y = LOAD(y);
  return u;
}

void store_nodes(const Vec2 u, global real* row, const int first, const int nx) {
#if WIDTH > 1
  if (first + WIDTH <= nx) {
    vec a, b;
    a.even = u.x.lo;
    a.odd = u.y.lo;
    b.even = u.x.hi;
    b.odd = u.y.hi;
    STORE(a, row + 2 * first);
    STORE(b, row + 2 * first + WIDTH);
    return;
  }
#endif
  real x[WIDTH], y[WIDTH];
  STORE(u.x, x);
  STORE(u.y, y);
  for (int lane = 0; lane < WIDTH && first + lane < nx; ++lane) {
    row[2 * (first + lane)] = x[lane];
    row[2 * (first + lane) + 1] = y[lane];
  }
}

// One number each of WIDTH elements of a row of `count`; zero beyond its ends, and everywhere unless `there`.
vec load_elements(global const real* row, const int first, const int count, const bool there) {
  if (there && first >= 0 && first + WIDTH <= count) return LOAD(row + first);
  real values[WIDTH];
  for (int lane = 0; lane < WIDTH; ++lane)
    values[lane] = there && first + lane >= 0 && first + lane < count ? row[first + lane] : 0;
  return LOAD(values);
}

Vec2 plus(const Vec2 a, const Vec2 b) {
  const Vec2 sum = {a.x + b.x, a.y + b.y};
  return sum;
}

Vec2 minus(const Vec2 a, const Vec2 b) {
  const Vec2 difference = {a.x - b.x, a.y - b.y};
  return difference;
}

// Forces on one corner, of signs s and t, of an element with displacements wu, eu, wd, ed (west/east,
// up/down), w = 1/r and third = mu / 3. Only differences of displacement enter: a rigid translation gives
// exactly nothing, in float too.
Vec2 corner_force(const Vec2 wu, const Vec2 eu, const Vec2 wd, const Vec2 ed, const real s, const real t,
                  const vec r, const vec w, const vec mu, const vec third, const vec lambda) {
  const Vec2 along_up = minus(eu, wu), along_down = minus(ed, wd);  // differences in x
  const Vec2 down_west = minus(wd, wu), down_east = minus(ed, eu);  // differences in y
  const Vec2 along = plus(along_up, along_down), down = plus(down_west, down_east);
  const Vec2 x_part = plus(along, t < 0 ? along_up : along_down);  // six times M times the differences
  const Vec2 y_part = plus(down, s < 0 ? down_west : down_east);
  // One change of volume for both directions: rounding it is then no shear, which lambda would magnify.
  const vec volume_x = lambda / 4 * (r * along.x + down.y);
  const vec volume_y = w * volume_x;
  const Vec2 force = {
      s * (third * r * x_part.x + volume_x) + t * (third / 2 * w * y_part.x + mu / 4 * along.y),
      t * (third * w * y_part.y + volume_y) + s * (third / 2 * r * x_part.y + mu / 4 * down.x)};
  return force;
}

vec where_free(const vec is_free, const vec force, const vec otherwise) {
  return is_free * force + (1 - is_free) * otherwise;
}

// width, height: of the columns and rows of elements, then their reciprocals, here and below. modulus: of the
// elements, then a third of each one's mu, divided beforehand as divisions would take most of the time; not
// by a rounded 1/3, which would be wrong alike in all units (error estimate).
//
// y = K x on unconstrained unknowns; with `constrain`, y = x on the others (x must vanish there), without, y
// = K x there too: the reactions. Items: (i / WIDTH, j, right-hand side). Reads 18 + 8 + 8 reals, about 240
// flops per node.
kernel void elasticity_apply(global const real* restrict x, global real* restrict y,
                             global const real* restrict modulus, global const real* restrict width,
                             global const real* restrict height, global const real* restrict free,
                             const real mu_per_e, const real lambda_per_e, const int constrain, const int nx,
                             const int ny) {
  const int j = get_global_id(1), base = 2 * get_global_id(2) * nx * ny;
  if (WIDTH * get_global_id(0) >= nx || j >= ny) return;
  const int i = min(WIDTH * (int)get_global_id(0), max(nx - WIDTH, 0));  // the last takes some again
  const int ex = nx - 1, ey = ny - 1, row = 2 * nx * j;
  const bool up = j > 0, down = j < ey;
  // Elements beyond the edge have no stiffness.
  const vec e_lu = load_elements(modulus + ex * (j - 1), i - 1, ex, up);
  const vec e_ru = load_elements(modulus + ex * (j - 1), i, ex, up);
  const vec e_ld = load_elements(modulus + ex * j, i - 1, ex, down);
  const vec e_rd = load_elements(modulus + ex * j, i, ex, down);
  const vec w_l = load_elements(width, i - 1, ex, true), per_l = load_elements(width + ex, i - 1, ex, true);
  const vec w_r = load_elements(width, i, ex, true), per_r = load_elements(width + ex, i, ex, true);
  global const real* thirds = modulus + ex * ey;
  const vec third_lu = load_elements(thirds + ex * (j - 1), i - 1, ex, up);
  const vec third_ru = load_elements(thirds + ex * (j - 1), i, ex, up);
  const vec third_ld = load_elements(thirds + ex * j, i - 1, ex, down);
  const vec third_rd = load_elements(thirds + ex * j, i, ex, down);
  const real h_u = up ? height[j - 1] : 0, per_u = up ? height[ey + j - 1] : 0;
  const real h_d = down ? height[j] : 0, per_d = down ? height[ey + j] : 0;
  global const real* u = x + base + row;
  global const real *above = u - (up ? 2 * nx : 0), *below = u + (down ? 2 * nx : 0);
  const Vec2 uw = load_nodes(above, i - 1, nx), un = load_nodes(above, i, nx);
  const Vec2 ue = load_nodes(above, i + 1, nx);
  const Vec2 cw = load_nodes(u, i - 1, nx), cc = load_nodes(u, i, nx), ce = load_nodes(u, i + 1, nx);
  const Vec2 dw = load_nodes(below, i - 1, nx), ds = load_nodes(below, i, nx);
  const Vec2 de = load_nodes(below, i + 1, nx);
  Vec2 force = corner_force(uw, un, cw, cc, 1, 1, h_u * per_l, w_l * per_u, mu_per_e * e_lu, third_lu,
                            lambda_per_e * e_lu);
  force = plus(force, corner_force(un, ue, cc, ce, -1, 1, h_u * per_r, w_r * per_u, mu_per_e * e_ru, third_ru,
                                   lambda_per_e * e_ru));
  force = plus(force, corner_force(cw, cc, dw, ds, 1, -1, h_d * per_l, w_l * per_d, mu_per_e * e_ld, third_ld,
                                   lambda_per_e * e_ld));
  force = plus(force, corner_force(cc, ce, ds, de, -1, -1, h_d * per_r, w_r * per_d, mu_per_e * e_rd,
                                   third_rd, lambda_per_e * e_rd));
  Vec2 is_free = {(vec)(1), (vec)(1)};
  if (constrain) is_free = load_nodes(free + row, i, nx);
  force.x = where_free(is_free.x, force.x, cc.x);
  force.y = where_free(is_free.y, force.y, cc.y);
  store_nodes(force, y + base + row, i, nx);
}

// 2x2 block between two corners of an element (formulas above), w = 1/r.
real4 corner_block(const real s, const real t, const real s2, const real t2, const real r, const real w,
                   const real mu, const real lambda) {
  const real mass_x = s == s2 ? 1 / REAL(3.0) : 1 / REAL(6.0),
             mass_y = t == t2 ? 1 / REAL(3.0) : 1 / REAL(6.0);
  const real in_x = r * s * s2 * mass_y, in_y = w * t * t2 * mass_x, quarter = lambda / 4;
  return (real4)(mu * (2 * in_x + in_y) + quarter * r * s * s2, mu / 4 * t * s2 + quarter * s * t2,
                 mu / 4 * s * t2 + quarter * t * s2, mu * (2 * in_y + in_x) + quarter * w * t * t2);
}

// The same operator as a stencil (stencil.clh), constrained unknowns as identity. Items: (i, j, block k - 4).
kernel void elasticity_stencil(global real4* restrict stencil, global const real* restrict modulus,
                               global const real* restrict width, global const real* restrict height,
                               global const real2* restrict free, const real mu_per_e,
                               const real lambda_per_e, const int nx, const int ny) {
  const int i = get_global_id(0), j = get_global_id(1), k = get_global_id(2) + 4;
  if (i >= nx || j >= ny) return;
  const int di = k % 3 - 1, dj = k / 3 - 1, node = i + nx * j;
  real4 sum = (real4)(0);
  if (i + di >= 0 && i + di < nx && j + dj < ny) {
    // Elements (i - 1 + a, j - 1 + b) that hold both nodes; the corner's sign is + on the far side.
    for (int b = 0; b < 2; ++b)
      for (int a = 0; a < 2; ++a) {
        const int column = i - 1 + a, row = j - 1 + b;
        const bool both = (di == 0 || di == 2 * a - 1) && (dj == 0 || dj == 2 * b - 1);
        if (!both || column < 0 || column >= nx - 1 || row < 0 || row >= ny - 1) continue;
        const real s = 1 - 2 * a, t = 1 - 2 * b, e = modulus[column + (nx - 1) * row];
        const real r = height[row] * width[nx - 1 + column], w = width[column] * height[ny - 1 + row];
        sum += corner_block(s, t, di == 0 ? s : -s, dj == 0 ? t : -t, r, w, mu_per_e * e, lambda_per_e * e);
      }
    const real2 row_free = free[node], to = free[node + di + nx * dj];
    sum *= (real4)(row_free.x * to.x, row_free.x * to.y, row_free.y * to.x, row_free.y * to.y);
    if (k == 4) sum += (real4)(1 - row_free.x, 0, 0, 1 - row_free.y);
  }
  stencil[k * nx * ny + node] = sum;
  mirror_block(stencil, sum, i, j, k, nx, ny);
}
