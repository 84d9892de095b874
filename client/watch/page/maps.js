// The maps of the page as images: painted again only when they, or the colours, are others.
import { image } from './draw.js';
import { coloured, colours, extent } from './layout.js';

export const table = colours();
// Whether all of the tissue was given, and not estimated.
export const given = (scene) => !!scene?.windows?.length && scene.windows.every((w) => w.given);
let maps = null;  // painted: modulus (and its pixels), deviation, B-mode
let images = new Map();  // B-mode, by the number of each
function greyImage(part) {
  const [height, width] = part.shape;
  const pixels = new Uint8ClampedArray(4 * width * height);
  for (let n = 0; n < width * height; ++n) {
    pixels[4 * n] = pixels[4 * n + 1] = pixels[4 * n + 2] = part.values[n];
    pixels[4 * n + 3] = 255;
  }
  return image(pixels, width, height);
}

// Of the model's maps, once for each: what cannot be told is `unknown`.
export function paint(model, unknown) {
  if (maps && maps.of === model.map && maps.log === model.logModulus && maps.images === model.b_mode) return maps;
  maps = { of: model.map, log: model.logModulus, images: model.b_mode, modulus: null, pixels: null, deviation: null, states: false, bMode: [] };
  const map = model.map;
  if (map?.modulus_pa) {
    const [height, width] = map.modulus_pa.shape;
    const values = map.modulus_pa.values, valid = map.valid?.values, deviations = map.log_std?.values;
    const known = (n) => values[n] > 0 && (!valid || valid[n] > 0);
    const range = extent(values, known);
    if (range) {
      const doubt = deviations ? (n) => Math.min(0.85, Math.max(0, ((deviations[n] || 0) - 0.1) / 0.5)) : undefined;
      maps.range = range;
      const pixels = coloured(values, known, range, model.logModulus, table, unknown, doubt);
      maps.modulus = image(pixels, width, height);
      maps.pixels = { values: new Uint32Array(pixels.buffer), width, height };
      const stated = (n) => known(n) && deviations[n] > 0;  // 0 is not one
      maps.states = deviations ? extent(deviations, stated) !== null : false;
      if (deviations) {
        maps.deviationRange = [0, Math.max(0.1, extent(deviations, stated)?.[1] ?? 0.1)];
        maps.deviation = image(coloured(deviations, stated, maps.deviationRange, false, table, unknown), width, height);
      }
    }
  }
  const grey = new Map();  // of windows that are as they were painted
  for (const part of model.b_mode?.arrays ?? []) {
    const canvas = images.get(part.drawn) ?? greyImage(part);
    grey.set(part.drawn, canvas);
    maps.bMode.push({ part, canvas });
  }
  images = grey;
  return maps;
}

// The colours are others.
export function paintAnew() {
  maps = null;
}
