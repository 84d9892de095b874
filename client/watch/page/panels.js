// The pictures of the page: what each draws of the model at a time.
import { coloured, flags, scale, shown } from './layout.js';
import { given, paint, paintAnew, table } from './maps.js';
import { gaveWay, pressed, rise, section, tellsOf, valueAt } from './tissue.js';
import { band, colourBar, image, legend, Picture, Pixels, readPalette, rgb, Still, timeAxis, trace, yAxis } from './draw.js';

let palette = readPalette();
export const pictures = Object.fromEntries(['tissue', 'close', 'force', 'ages', 'servo', 'tactile'].map((id) => [id, new Picture(id)]));
export function repaint() {
  palette = readPalette();
  paintAnew();
  for (const picture of Object.values(pictures)) picture.dirty = true;
}

// Of a row of the series.
export function row(series, n) {
  const at = (name) => series.value(n, series.index[name]);
  const f = [at('force_x_n'), at('force_y_n'), at('force_z_n')];
  return { at, time: series.time(n), position: [at('x_m'), at('y_m'), at('z_m')], force: f, size: Math.hypot(...f), ...flags(at('flags')) };
}

const sizeOf = (model) => {
  const size = model.scene?.size_m;
  return size?.length >= 2 ? size : [0.3, 0.05];
};

function fingertip(model) {
  const tip = model.status?.open?.fingertip ?? {};
  const punch = /PUNCH|PAD/.test(tip.shape ?? '');
  return { radius: tip.radius_m || 0.008, flat: punch ? tip.half_width_m || (/PAD/.test(tip.shape) ? 0.008 : 0.004) : 0 };
}

const asItStands = new Still();
export function tissue(model, now) {
  const picture = pictures.tissue;
  const painted = paint(model, rgb(palette.unknown));
  const deviation = painted.deviation && (painted.states || !given(model.scene));
  const [width, depth] = sizeOf(model);
  const left = 44, right = picture.measured - 76, head = 34, gap = 24;
  const perM = (right - left) / width;
  const tall = Math.min(240, Math.max(72, depth * perM));
  const names = [...(painted.bMode.length ? ['B-mode'] : []), "Young's modulus", ...(deviation ? ['its standard deviation (of ln E)'] : [])];
  const strips = names.map((name, n) => ({ name, left, right, top: head + n * (tall + gap), bottom: head + n * (tall + gap) + tall }));
  const pen = picture.begin(head + strips.length * (tall + gap) + (deviation ? 0 : 16));
  const x = (m) => left + m * perM;
  asItStands.onto(picture, [painted, model.scene], (still) => {
    for (const box of strips) strip(still, model, painted, box, x, depth);
    still.fillStyle = palette.soft;
    still.textAlign = 'center';
    still.textBaseline = 'top';
    const marks = right - left > 420 ? 6 : 3, low = strips.at(-1).bottom;
    for (let n = 0; n <= marks; ++n) still.fillText(`${Math.round((1e3 * width * n) / marks)} mm`, x((width * n) / marks), low + 5);
    if (!deviation) deviations(still, model, x, low + 21);
  });
  let read = (!painted.range && model.status?.no_maps) || 'point or use arrows to read values';
  for (const box of strips) {
    const cursor = picture.cursor;
    if (cursor && cursor[0] >= left && cursor[0] <= right && cursor[1] >= box.top && cursor[1] <= box.bottom) {
      read = valueAt(model.map, [(cursor[0] - left) / perM, ((cursor[1] - box.top) / tall) * depth]);
      cross(pen, cursor, box);
    }
    if (now) finger(pen, model, now, x, (m) => box.top + (m / depth) * tall);
  }
  const active = model.windows?.filter((w) => w.stage !== 'published' && w.origin_m) ?? [];
  pen.lineWidth = 2;
  for (const w of active) {
    pen.strokeStyle = palette.orange;
    pen.setLineDash([5, 4]);
    pen.strokeRect(x(w.origin_m[0]), head, (w.width_m ?? 0.04) * perM, tall);
    pen.setLineDash([]);
  }
  picture.say(read);
  picture.label(`modulus of the tissue, version ${model.map?.version ?? 0}${painted.range ? `, from ${shown(painted.range[0], 'Pa')} to ${shown(painted.range[1], 'Pa')}` : ', none yet'}`);
}

// One of the maps, with its name, its depth and its colours.
function strip(pen, model, painted, box, x, depth) {
  const perDepth = (box.bottom - box.top) / depth;
  pen.fillStyle = palette.unknown;
  pen.fillRect(box.left, box.top, box.right - box.left, box.bottom - box.top);
  const place = (canvas, grid) => pen.drawImage(canvas, x(grid.origin_m[0] - grid.spacing_m[0] / 2), box.top + (grid.origin_m[1] - grid.spacing_m[1] / 2) * perDepth,
    x(canvas.width * grid.spacing_m[0]) - x(0), canvas.height * grid.spacing_m[1] * perDepth);
  const bar = { left: box.right + 10, top: box.top, bottom: box.bottom };
  if (box.name === 'B-mode') {
    for (const { part, canvas } of painted.bMode) place(canvas, part);
  } else if (box.name !== "Young's modulus") {
    place(painted.deviation, model.map);
    colourBar(pen, bar, scale(false, ...painted.deviationRange, bar.bottom, bar.top), table, '');
  } else if (painted.modulus) {
    place(painted.modulus, model.map);
    colourBar(pen, bar, scale(model.logModulus, ...painted.range, bar.bottom, bar.top), table, 'Pa');
  }
  pen.font = '600 11px system-ui, "DejaVu Sans", sans-serif';
  pen.fillStyle = palette.soft;
  pen.textAlign = 'left';
  pen.textBaseline = 'bottom';
  pen.fillText(box.name, box.left, box.top - 4);
  pen.font = '11px system-ui, "DejaVu Sans", sans-serif';
  pen.textAlign = 'right';
  pen.textBaseline = 'middle';
  pen.fillText('0', box.left - 6, box.top + 5);
  pen.fillText(shown(depth, 'm'), box.left - 6, box.bottom - 5);
}

// What each window states of its modulus, where there is no map of it.
function deviations(pen, model, x, y) {
  if (given(model.scene)) pen.fillText('given: no deviation is stated', x(sizeOf(model)[0] / 2), y);
  let free = -Infinity;
  for (const w of [...(model.scene?.windows ?? [])].sort((a, b) => a.begin_x_m - b.begin_x_m)) {
    if (!(w.log_std > 0)) continue;
    const text = `± ${(100 * w.log_std).toFixed(0)} %`, middle = x((w.begin_x_m + w.end_x_m) / 2), half = pen.measureText(text).width / 2 + 3;
    if (middle - half < free) continue;
    pen.fillText(text, middle, y);
    free = middle + half;
  }
}

function cross(pen, [x, y], box) {
  pen.strokeStyle = palette.ink;
  pen.globalAlpha = 0.6;
  pen.beginPath();
  pen.moveTo(box.left, y + 0.5); pen.lineTo(box.right, y + 0.5);
  pen.moveTo(x + 0.5, box.top); pen.lineTo(x + 0.5, box.bottom);
  pen.stroke();
  pen.globalAlpha = 1;
}

function finger(pen, model, now, x, y) {
  const tip = fingertip(model), reach = tip.flat + tip.radius;
  const [fx, fy] = now.position;
  pen.beginPath();
  for (let n = -20; n <= 20; ++n) {
    const off = (n / 20) * reach;
    const point = [x(fx + off), y(fy - rise(tip, off))];
    if (n === -20) pen.moveTo(...point); else pen.lineTo(...point);
  }
  pen.closePath();
  pen.fillStyle = palette.ink;
  pen.globalAlpha = 0.85;
  pen.fill();
  pen.globalAlpha = 1;
  pen.strokeStyle = palette.panel;
  pen.stroke();
}

// --- under the finger --------------------------------------------------------------------------------------

const kSurfaceMs = 2000;  // how old it may be
const drawn = new Pixels();
const rgba = (hex) => new Uint32Array(new Uint8Array([...rgb(hex), 255]).buffer);

export function close(model, now) {
  const picture = pictures.close;
  const painted = paint(model, rgb(palette.unknown));
  const [width, depth] = sizeOf(model);
  const across = 0.06, left = 44, right = picture.measured - 12, head = 70;
  const perM = (right - left) / across;
  const tall = Math.min(300, depth * perM);
  const pen = picture.begin(head + tall + 22);
  if (!now) { picture.say('no finger yet'); return; }
  const layer = model.status?.open?.layer?.depth_m ?? 0;
  const [fx, fy] = now.position;
  const begin = Math.min(Math.max(fx - across / 2, -across / 4), width - (3 * across) / 4);
  const tip = fingertip(model), indentation = fy - layer;
  const x = (m) => left + (m - begin) * perM, y = (m) => head + m * perM;
  const bottom = head + tall, shownDepth = tall / perM;
  const map = model.map;
  const { surface } = model, young = surface && !model.paused && performance.now() - surface.came < kSurfaceMs;
  const solved = young && tellsOf(surface, layer, fx) ? surface : null;
  const gave = (at) => (solved ? gaveWay(solved, at, now.position[2]) : pressed(tip, indentation, at - fx));
  pen.save();
  pen.beginPath();
  pen.rect(left, 0, right - left, bottom);
  pen.clip();
  const step = 2, line = [], from = [], moved = [];
  const pixels = painted.pixels ?? { values: rgba(palette.unknown), width: 1, height: 1 };
  for (let px = left; px < right; px += step) {
    const at = begin + (px - left) / perM, inside = at >= 0 && at <= width;
    const gone = inside ? y(layer + gave(at)) : 0;
    from.push(!inside ? -1 : painted.pixels ? Math.min(pixels.width - 1, Math.max(0, Math.floor((at - map.origin_m[0]) / map.spacing_m[0] + 0.5))) : 0);
    moved.push(gone * picture.ratio);
    if (inside) line.push([px, gone]);
  }
  const row = (m) => (painted.pixels ? Math.min(pixels.height, m / map.spacing_m[1]) : m);
  drawn.shape(from.length, Math.round(bottom * picture.ratio));
  section(drawn.pixels, { image: pixels, from, layer: row(layer), last: row(shownDepth), surface: y(0) * picture.ratio, moved });
  pen.imageSmoothingEnabled = false;
  pen.drawImage(drawn.canvas(), left, 0, step * from.length, bottom);
  pen.strokeStyle = palette.ink;
  pen.lineWidth = 2;
  pen.beginPath();
  for (const point of line) pen.lineTo(...point);
  pen.stroke();
  pen.lineWidth = 1;
  finger(pen, model, now, x, y);
  const long = 55 * Math.min(1, now.size / Math.max(0.2, model.largestForce || 1));
  if (now.size > 1e-6) arrow(pen, x(fx), y(fy) - 4, (now.force[0] / now.size) * long, (now.force[1] / now.size) * long);
  pen.restore();
  pen.fillStyle = palette.soft;
  pen.textAlign = 'center';
  pen.textBaseline = 'top';
  const every = right - left > 420 ? 10 : 20;
  for (let mm = Math.ceil((1e3 * begin) / every) * every; mm <= 1e3 * (begin + across); mm += every) pen.fillText(`${mm} mm`, x(mm / 1e3), bottom + 5);
  const where = `x ${(1e3 * fx).toFixed(1)} mm, z ${(1e3 * now.position[2]).toFixed(1)} mm, `;
  picture.say(where + (indentation > 0 ? `${(1e3 * indentation).toFixed(2)} mm deep, surface ${solved ? 'solved' : 'drawn'}` : `${(-1e3 * indentation).toFixed(1)} mm above`));
  picture.label(`tissue under the finger: ${indentation > 0 ? 'in contact' : 'not in contact'}`);
}

function arrow(pen, x, y, dx, dy) {
  const size = Math.hypot(dx, dy);
  if (size < 2) return;
  const [ux, uy] = [dx / size, dy / size];
  pen.strokeStyle = pen.fillStyle = palette.orange;
  pen.lineWidth = 3;
  pen.beginPath(); pen.moveTo(x, y); pen.lineTo(x + dx, y + dy); pen.stroke();
  pen.beginPath();
  pen.moveTo(x + dx + 8 * ux, y + dy + 8 * uy);
  pen.lineTo(x + dx - 5 * uy, y + dy + 5 * ux);
  pen.lineTo(x + dx + 5 * uy, y + dy - 5 * ux);
  pen.fill();
  pen.lineWidth = 1;
}

// --- over time ---------------------------------------------------------------------------------------------

const stateColour = (f) => (f.state === 'FAULT' ? palette.bad : f.state === 'PAUSED' ? palette.wait : f.state === 'DISABLED' ? palette.grey : f.degraded || f.faded ? palette.orange : palette.good);
export const stateName = (f) => (f.state === 'ENABLED' && (f.degraded || f.faded) ? 'DEGRADED' : f.state);

function plot(id, model, height, log, low, high, unit, draw, values) {
  const picture = pictures[id];
  const { series, from, to, newest } = model;
  const ribbon = id === 'force' ? 12 : 0;
  const pen = picture.begin(height + ribbon);
  const box = { left: 62, right: picture.width - 10, top: 6, bottom: height - 22 };
  const scaled = scale(log, low, high, box.bottom, box.top);
  timeAxis(pen, from, to, newest, box);
  yAxis(pen, scaled, box, unit);
  pen.save();
  pen.beginPath();
  pen.rect(box.left, box.top - 2, box.right - box.left, box.bottom - box.top + 4);
  pen.clip();
  draw(pen, box, scaled);
  const cursor = picture.cursor;
  if (cursor && cursor[0] >= box.left && series.count) {
    const time = from + ((cursor[0] - box.left) / (box.right - box.left)) * (to - from);
    const n = series.at(time);
    cross(pen, [cursor[0], -10], box);
    picture.say(n >= 0 ? `${(time - newest).toFixed(2)} s: ${values(row(series, n))}` : '');
  } else {
    picture.say(model.row ? values(model.row) : '');
  }
  pen.restore();
  if (ribbon) states(pen, model, { ...box, top: height, bottom: height + ribbon - 2 });
  picture.label(`${id} over the last ${model.to - model.from} s`);
}

function states(pen, { series, from, to }, box) {
  const scaleX = (box.right - box.left) / (to - from);
  let begin = null, colour = null;
  const end = (time) => {
    if (begin === null) return;
    pen.fillStyle = colour;
    const x = box.left + Math.max(0, begin - from) * scaleX;
    pen.fillRect(x, box.top, Math.max(1, box.left + (time - from) * scaleX - x), box.bottom - box.top);
  };
  const column = series.index.flags;
  let last = from;
  for (let n = series.find(from); n < series.added && series.time(n) <= to; ++n) {
    const next = stateColour(flags(series.value(n, column)));
    if (next !== colour) { end(series.time(n)); begin = series.time(n); colour = next; }
    last = series.time(n);
  }
  end(last);
}

// What the force is stated to be within; further up than down where the tissue may stiffen with strain.
export function interval(row, digits) {
  const half = row.at('half_width'), above = row.at('above');
  if (!(half >= 0)) return '';
  const percent = (share) => (100 * share).toFixed(digits);
  return above > 0 ? ` −${percent(half)} to +${percent(half + above)} %` : ` ± ${percent(half)} %`;
}

export function force(model) {
  const { series } = model;
  let most = 0.2;
  const ix = series.index;
  const size = (n) => Math.hypot(series.value(n, ix.force_x_n), series.value(n, ix.force_y_n), series.value(n, ix.force_z_n));
  for (let n = series.find(model.from); n < series.added && series.time(n) <= model.to; ++n) most = Math.max(most, size(n));
  model.largestForce = most;
  plot('force', model, 170, false, -0.15 * most, 1.2 * most, 'N', (pen, box, scaled) => {
    band(pen, series, (n) => -series.value(n, ix.force_y_n), (n) => series.value(n, ix.half_width), (n) => series.value(n, ix.above), model.from, model.to, box, scaled, palette.blue);
    trace(pen, { find: (t) => series.find(t), time: (n) => series.time(n), get added() { return series.added; }, value: (n) => -series.value(n, ix.force_y_n), extremes: series.extremes }, 0, model.from, model.to, box, scaled, palette.blue);
    trace(pen, series, ix.force_x_n, model.from, model.to, box, scaled, palette.orange);
    legend(pen, box, [['outwards, with its 95 % interval', palette.blue], ['along x', palette.orange]]);
  }, (r) => `${shown(-r.force[1], 'N')} outwards, ${shown(r.force[0], 'N')} along x${interval(r, 1)}`);
}

export function ages(model) {
  const { series, logTimes } = model;
  const ix = series.index;
  plot('ages', model, 150, logTimes, logTimes ? 1e-4 : 0, logTimes ? 10 : model.largest(['model_age_s', 'silence_s', 'round_trip_s'], 0.05), 's', (pen, box, scaled) => {
    trace(pen, series, ix.model_age_s, model.from, model.to, box, scaled, palette.blue);
    trace(pen, series, ix.silence_s, model.from, model.to, box, scaled, palette.orange);
    trace(pen, series, ix.round_trip_s, model.from, model.to, box, scaled, palette.green);
    legend(pen, box, [['age of what is rendered', palette.blue], ['silence', palette.orange], ['round trip', palette.green]]);
  }, (r) => `age ${shown(r.at('model_age_s'), 's')}, silence ${shown(r.at('silence_s'), 's')}, round trip ${shown(r.at('round_trip_s'), 's')}`);
}

export function servo(model) {
  const { series, logTimes } = model;
  const ix = series.index;
  plot('servo', model, 130, logTimes, logTimes ? 1e-6 : 0, logTimes ? 0.1 : model.largest(['period_s', 'lateness_s'], 0.002), 's', (pen, box, scaled) => {
    trace(pen, series, ix.period_s, model.from, model.to, box, scaled, palette.blue);
    trace(pen, series, ix.lateness_s, model.from, model.to, box, scaled, palette.violet);
    legend(pen, box, [['longest period in 10 ms', palette.blue], ['largest lateness', palette.violet]]);
  }, (r) => `period ${shown(r.at('period_s'), 's')}, late by ${shown(r.at('lateness_s'), 's')}`);
}

export function tactile(model) {
  const shownImage = model.tactile;
  document.getElementById('tactile-panel').hidden = !shownImage?.pressure_pa;
  if (!shownImage?.pressure_pa) return;
  const picture = pictures.tactile;
  const parts = [['pressure', shownImage.pressure_pa], ['beyond homogeneous tissue', shownImage.beyond_pa]].filter(([, a]) => a);
  const [nz, nx] = shownImage.pressure_pa.shape;
  const side = Math.min(150, (picture.measured - 20) / parts.length / nx * nz);
  const pen = picture.begin(side + 26);
  const reads = [];
  parts.forEach(([name, array], p) => {
    const size = Math.max(1, ...array.values.map(Math.abs));
    const pixels = coloured(array.values.map((v) => Math.abs(v)), () => true, [0, size], false, table, rgb(palette.unknown));
    pen.imageSmoothingEnabled = false;
    const left = p * (side * nx / nz + 14);
    pen.drawImage(image(pixels, nx, nz), left, 4, side * nx / nz, side);
    pen.fillStyle = palette.soft;
    pen.textAlign = 'left';
    pen.textBaseline = 'top';
    pen.fillText(p ? 'beyond layers' : name, left, side + 9);
    reads.push(shown(size, 'Pa'));
  });
  picture.say(`full scale ${reads.join(', ')}`);
  picture.label(`tactile image of ${nx} x ${nz} taxels, full scale ${reads.join(', ')}`);
}

export function timeline(canvas, model) {
  const { spells, length_s: length } = model.timeline;
  const width = canvas.clientWidth, height = 18;
  canvas.width = width;
  canvas.height = height;
  canvas.style.height = `${height}px`;
  const pen = canvas.getContext('2d');
  spells.forEach((spell, n) => {
    pen.fillStyle = stateColour(spell);
    const x = (spell.at_s / length) * width, end = ((spells[n + 1]?.at_s ?? length) / length) * width;
    pen.fillRect(x, 0, Math.max(1, end - x), height);
  });
  const at = ((model.status?.playing?.at_s ?? 0) / length) * width;
  pen.fillStyle = palette.ink;
  pen.fillRect(at - 1, 0, 2, height);
}
