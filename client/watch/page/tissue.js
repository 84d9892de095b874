// What is under a cursor, and how tissue gives way under a tip. Pure; metres.
import { shown } from './layout.js';

// In words, of a map at [x, y].
export function valueAt(map, [x, y]) {
  const place = `x ${(1e3 * x).toFixed(1)} mm, y ${(1e3 * y).toFixed(1)} mm`;
  if (!map?.modulus_pa) return place;
  const [height, width] = map.modulus_pa.shape;
  const i = Math.round((x - map.origin_m[0]) / map.spacing_m[0]), j = Math.round((y - map.origin_m[1]) / map.spacing_m[1]);
  if (i < 0 || j < 0 || i >= width || j >= height) return place;
  const n = j * width + i;
  const measured = !map.valid || map.valid.values[n] > 0;
  const value = map.modulus_pa.values[n], deviation = map.log_std?.values[n];
  if (!(value > 0)) return `${place}: not acquired`;
  return `${place}: ${measured ? '' : 'not measured, extrapolated: '}${shown(value, 'Pa')}${measured && deviation > 0 ? ` ± ${(100 * deviation).toFixed(0)} %` : ''}`;
}

// How far the tip's skin lies above its foremost point.
export const rise = (tip, off) => (Math.max(0, Math.abs(off) - tip.flat) ** 2) / (2 * tip.radius);

// Whether it is of this layer, that the service took the nearest to, and of a finger there: at rest, or with nodes about it.
export function tellsOf(surface, layer, x) {
  const xs = surface.x_m.values;
  return Math.abs(surface.depth_m - layer) < 2e-3 && (!xs.length || (x >= xs[0] && x <= xs[xs.length - 1]));
}

// How far the touched layer has given way at [x, z], as the service solved it (client/watch/view.cpp): between its nodes along
// x, in the row of nodes nearest to z. Beyond them it comes back over 10 mm: drawn, not solved.
export function gaveWay(surface, x, z) {
  const xs = surface.x_m.values, zs = surface.z_m.values, moved = surface.displacement_m.values;
  if (!xs.length) return 0;
  let row = 0;
  for (let k = 1; k < zs.length; ++k) if (Math.abs(zs[k] - z) < Math.abs(zs[row] - z)) row = k;
  const at = (n) => moved[row * xs.length + n], last = xs.length - 1;
  const beyond = Math.max(xs[0] - x, x - xs[last]);
  if (beyond >= 0) return at(x <= xs[0] ? 0 : last) * Math.max(0, 1 - beyond / 0.01);
  let n = 1;
  while (xs[n] < x) ++n;
  const share = (x - xs[n - 1]) / (xs[n] - xs[n - 1]);
  return (1 - share) * at(n - 1) + share * at(n);
}

// The section under the finger, pixels of `image` to those of `out`, which is cleared: in column c what lies in the rows of image up
// to `layer` is drawn from `surface` to moved[c], and what lies between `layer` and `last` from there to the end. `from`[c]: the
// column of image, -1 for none. Nothing is smoothed: cells are seen as they were estimated.
export function section(out, { image, from, layer, last, surface, moved }) {
  const columns = moved.length, height = out.length / columns;
  out.fill(0);
  const piece = (c, first, end, top, bottom) => {
    const perPixel = (end - first) / (bottom - top);
    if (!(perPixel > 0)) return;
    const until = Math.min(height, Math.round(bottom));
    for (let y = Math.max(0, Math.round(top)); y < until; ++y) {
      const row = Math.min(image.height - 1, Math.max(0, Math.floor(first + (y + 0.5 - top) * perPixel)));
      out[y * columns + c] = image.values[row * image.width + from[c]];
    }
  };
  for (let c = 0; c < columns; ++c) {
    if (from[c] < 0) continue;
    piece(c, 0, layer, surface, moved[c]);
    piece(c, layer, last, moved[c], height);
  }
}

// How far the surface has given way beside a tip in contact: it follows the tip, and comes back over its reach.
export function pressed(tip, indentation, off) {
  if (indentation <= 0) return 0;
  const half = tip.flat + Math.sqrt(tip.radius * indentation);  // about where a round tip lets go
  const edge = indentation - rise(tip, half);
  return Math.abs(off) <= half ? indentation - rise(tip, off) : edge * Math.exp(-(Math.abs(off) - half) / (1.5 * half + 1e-4));
}
