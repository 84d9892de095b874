// Plane-strain linear elasticity on bilinear quadrilaterals of a rectilinear grid (T4): 2 mu eps:eps
// integrated exactly (2x2 Gauss points), lambda (div u)^2 at the element centre. On an a x b rectangle with r
// = b/a, nodes with signs s (x) and t (y) at the corners, the element matrix of nodes m, n is
//   xx: mu (2 r s s' M_tt' + t t' M_ss' / r) + lambda r s s' / 4      M = 1/3 (same sign) or 1/6
//   xy: mu t s' / 4 + lambda s t' / 4
//   yy: mu (2 t t' M_ss' / r + r s s' M_tt') + lambda t t' / (4 r)
// Node (i, j) = i + nx j, element (i, j) = i + (nx - 1) j. mu = mu_per_e E, lambda = lambda_per_e E.
#include "stencil.clh"

// Forces on one corner, of signs s and t, of an element with displacements wu, eu, wd, ed (west/east,
// up/down) and w = 1/r. Only differences of displacement enter: a rigid translation gives exactly nothing, in
// float too.
real2 corner_force(const real2 wu, const real2 eu, const real2 wd, const real2 ed, const real s, const real t,
                   const real r, const real w, const real mu, const real lambda) {
  const real2 along_up = eu - wu, along_down = ed - wd;  // differences in x
  const real2 down_west = wd - wu, down_east = ed - eu;  // differences in y
  const real2 along = along_up + along_down, down = down_west + down_east;
  const real2 x_part = along + (t < 0 ? along_up : along_down);  // six times M times the differences
  const real2 y_part = down + (s < 0 ? down_west : down_east);
  // One change of volume for both directions: rounding it is then no shear, which lambda would magnify.
  const real volume_x = lambda / 4 * (r * along.x + down.y);
  const real volume_y = w * volume_x;
  // Divisions would take most of the time; but a rounded 1/3 would be wrong alike in all units (error
  // estimate).
  const real third = mu / 3;
  return (real2)(s * (third * r * x_part.x + volume_x) + t * (third / 2 * w * y_part.x + mu / 4 * along.y),
                 t * (third * w * y_part.y + volume_y) + s * (third / 2 * r * x_part.y + mu / 4 * down.x));
}

// width, height: of the columns and rows of elements, here and below.
//
// y = K x on unconstrained unknowns; with `constrain`, y = x on the others (x must vanish there), without, y
// = K x there too: the reactions. Items: (i, j, right-hand side). Reads 18 + 4 + 4 reals, about 240 flops.
kernel void elasticity_apply(global const real2* restrict x, global real2* restrict y,
                             global const real* restrict modulus, global const real* restrict width,
                             global const real* restrict height, global const real2* restrict free,
                             const real mu_per_e, const real lambda_per_e, const int constrain, const int nx,
                             const int ny) {
  const int i = get_global_id(0), j = get_global_id(1), base = get_global_id(2) * nx * ny;
  if (i >= nx || j >= ny) return;
  const int west = i > 0 ? 1 : 0, east = i + 1 < nx ? 1 : 0, up = j > 0 ? nx : 0, down = j + 1 < ny ? nx : 0;
  const int node = i + nx * j, ex = nx - 1;
  const int left = max(i - 1, 0), right = min(i, nx - 2), above = max(j - 1, 0), below = min(j, ny - 2);
  // Elements beyond the edge have no stiffness.
  const real e_lu = west && up ? modulus[left + ex * above] : 0,
             e_ru = east && up ? modulus[right + ex * above] : 0;
  const real e_ld = west && down ? modulus[left + ex * below] : 0,
             e_rd = east && down ? modulus[right + ex * below] : 0;
  const real w_l = width[left], w_r = width[right], h_u = height[above], h_d = height[below];
  global const real2* u = x + base + node;
  const real2 uw = u[-up - west], un = u[-up], ue = u[-up + east];
  const real2 cw = u[-west], cc = u[0], ce = u[east];
  const real2 dw = u[down - west], ds = u[down], de = u[down + east];
  const real per_l = 1 / w_l, per_r = 1 / w_r, per_u = 1 / h_u, per_d = 1 / h_d;
  real2 force =
      corner_force(uw, un, cw, cc, 1, 1, h_u * per_l, w_l * per_u, mu_per_e * e_lu, lambda_per_e * e_lu);
  force +=
      corner_force(un, ue, cc, ce, -1, 1, h_u * per_r, w_r * per_u, mu_per_e * e_ru, lambda_per_e * e_ru);
  force +=
      corner_force(cw, cc, dw, ds, 1, -1, h_d * per_l, w_l * per_d, mu_per_e * e_ld, lambda_per_e * e_ld);
  force +=
      corner_force(cc, ce, ds, de, -1, -1, h_d * per_r, w_r * per_d, mu_per_e * e_rd, lambda_per_e * e_rd);
  const real2 is_free = constrain ? free[node] : (real2)(1);
  y[base + node] = is_free * force + (1 - is_free) * cc;
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
        const real h = height[row], w = width[column];
        sum += corner_block(s, t, di == 0 ? s : -s, dj == 0 ? t : -t, h / w, w / h, mu_per_e * e,
                            lambda_per_e * e);
      }
    const real2 row_free = free[node], to = free[node + di + nx * dj];
    sum *= (real4)(row_free.x * to.x, row_free.x * to.y, row_free.y * to.x, row_free.y * to.y);
    if (k == 4) sum += (real4)(1 - row_free.x, 0, 0, 1 - row_free.y);
  }
  stencil[k * nx * ny + node] = sum;
  mirror_block(stencil, sum, i, j, k, nx, ny);
}
