// The page's pure modules: node --test tests/page
import assert from 'node:assert/strict';
import { test } from 'node:test';
import { decode } from '../../client/watch/page/decode.js';
import { coloured, colours, extent, player, scale, shown, ticks, why, whyOld } from '../../client/watch/page/layout.js';
import { given, paint, paintAnew } from '../../client/watch/page/maps.js';
import { Series } from '../../client/watch/page/series.js';
import { gaveWay, pressed, section, tellsOf, valueAt } from '../../client/watch/page/tissue.js';

function frameOf(number, slots) {
  const parts = [], word = (...words) => parts.push(new Uint8Array(new Uint32Array(words).buffer));
  const pad = (bytes) => { const out = new Uint8Array((bytes.length + 7) & ~7); out.set(bytes); return out; };
  word(0x544c5454, number, slots.length, 0);
  for (const [channel, json, data] of slots) {
    const text = new TextEncoder().encode(JSON.stringify(json));
    word(channel, text.length, data.length, 0);
    parts.push(pad(text), pad(data));
  }
  return new Uint8Array(Buffer.concat(parts)).buffer;
}
const floats = (...values) => new Uint8Array(new Float32Array(values).buffer);

test('a frame comes apart into slots whose arrays look into it', () => {
  const json = { begin_s: 2, arrays: [{ name: 'rows', type: 'float32', shape: [2, 2], at: 0 }] };
  const frame = decode(frameOf(7, [[0, json, floats(1, 2, 3, 4)], [99, {}, new Uint8Array(0)]]));
  assert.equal(frame.number, 7);
  assert.deepEqual([...frame.slots.trace.rows.values], [1, 2, 3, 4]);
  assert.equal(Object.keys(frame.slots).length, 1, 'a channel of a later version is left out');
});

test('what is no whole frame is refused', () => {
  const json = { arrays: [{ name: 'rows', type: 'float32', shape: [3], at: 0 }] };
  assert.throws(() => decode(new ArrayBuffer(8)), RangeError);
  assert.throws(() => decode(new ArrayBuffer(64)), RangeError);
  assert.throws(() => decode(frameOf(1, [[0, json, floats(1)]])), RangeError);
  assert.throws(() => decode(frameOf(1, [[0, json, floats(1)], [1, {}, floats(2, 3, 4, 5)]])), RangeError, 'nor does it reach into the next slot');
  const whole = frameOf(1, [[0, {}, floats(1, 2)]]);
  for (let size = 16; size < whole.byteLength; ++size) assert.throws(() => decode(whole.slice(0, size)));
});

test('what is not of now is said, and why', () => {
  const now = { open: true, session: 'live', playing: null, quiet_s: 0.02 };
  assert.equal(whyOld(now), '');
  assert.match(whyOld({ ...now, quiet_s: 1.5 }), /no tick/);
  assert.match(whyOld({ ...now, session: 'ended' }), /ended/);
  assert.match(whyOld({ ...now, open: false }), /does not answer/);
  assert.equal(whyOld({ ...now, session: undefined, playing: { at_s: 3 }, quiet_s: 60 }), '', 'a recording may stand');
  assert.match(whyOld({ ...now, session: 'broken off: it has gone', playing: { at_s: 3 } }), /^the recording: broken off/);
  assert.match(whyOld({ ...now, session: undefined }), /nothing is known/);
  assert.equal(whyOld({ ...now, session: 'ended', past: true }), '', 'who went back in time sees what was then');
});

test('the page names what reduces the force, and nothing else', () => {
  const say = (flags, values, claim = '') => why({ state: 'ENABLED', ...flags, at: (name) => ({ silence_s: 0.02, model_age_s: 0.03, withheld: 0, ...values })[name] }, 'resumed', claim);
  assert.equal(say({}, {}), 'resumed');
  assert.equal(say({ state: 'DISABLED', faded: true, degraded: true }, { silence_s: 1e9 }), 'resumed', 'its reason, not a silence');
  assert.equal(say({ faded: true }, { silence_s: 0.4 }), 'no answer for 400 ms: the force fades');
  assert.equal(say({ byService: true }, { withheld: 0.17 }), 'resumed; the service doubts its answer (17 % of the force is withheld)');
  assert.equal(say({ degraded: true }, { withheld: 0.6 }, 'another model needs 2 mJ more'), '60 % of the force is withheld: another model needs 2 mJ more');
  assert.equal(say({ degraded: true }, { model_age_s: 0.357 }, 'another model needs 2 mJ more'), 'the answer is 357 ms old: the force is reduced');
  assert.match(say({ degraded: true, debt: true }, { withheld: 0.3, model_age_s: 0.3 }), /energy.*30 % .* withheld; .*300 ms/);
  assert.match(say({ degraded: true, byLaw: true }, { model_age_s: 0.3 }), /^answers were too old/);
});

test('at the end of a recording Play begins again', () => {
  const at = { at_s: 1.04, length_s: 3.06, speed: 1, over: false };
  assert.deepEqual([player(at).text, player(at).button, player(at).order(2)], ['1.0 of 3.1 s', 'Pause', { speed: 0 }]);
  assert.deepEqual([player({ ...at, speed: 0 }).button, player({ ...at, speed: 0 }).order(2)], ['Play', { speed: 2 }]);
  assert.deepEqual([player({ ...at, over: true }).button, player({ ...at, over: true }).order(2)], ['Play', { speed: 2, seek_s: 0 }]);
});

test('a copy of a series stays as it is', () => {
  const series = new Series(4);
  series.clear(['time', 'value']);
  series.add(10, Float32Array.of(0, 1, 1, 2));
  const held = series.copy();
  series.add(12, Float32Array.of(0, 3, 1, 4, 2, 5));
  assert.deepEqual([held.count, held.time(held.added - 1), held.value(1, 1)], [2, 11, 2]);
  assert.deepEqual([series.count, series.first, series.time(series.added - 1)], [4, 1, 14]);
  assert.equal(held.csv(0, 20).split('\n').length, 4);
});

test('a series keeps the last rows, in time', () => {
  const series = new Series(10);
  series.clear(['t_s', 'v']);
  for (let n = 0; n < 25; ++n) series.add(100, new Float32Array([n, n * n]));
  assert.equal(series.count, 10);
  assert.equal(series.time(series.at(120.5)), 120);
  assert.equal(series.value(series.at(124), 1), 576);
  assert.equal(series.at(10), -1, 'before all that is kept');
  const low = new Float32Array(2), high = new Float32Array(2);
  series.extremes(1, 120, 124, 2, low, high);
  assert.deepEqual([...low, ...high], [400, 484, 441, 529]);
  assert.equal(series.csv(123, 124), 't_s,v\n123.0000,529\n124.0000,576\n');
});

test('scales go there and back, logarithmic ones too', () => {
  for (const log of [false, true]) {
    const s = scale(log, 1e-3, 10, 200, 0);
    for (const value of [1e-3, 0.02, 1, 10]) assert.ok(Math.abs(s.back(s.to(value)) / value - 1) < 1e-9);
    assert.ok(Math.abs(s.to(1e-3) - 200) < 1e-9);
    const at = ticks(s);
    assert.ok(at.length >= 2 && at.every((v) => v >= 1e-3 - 1e-12 && v <= 10 + 1e-9), String(at));
  }
  assert.equal(scale(true, 1e-3, 10, 200, 0).to(0), 200, 'nothing is as little as can be shown');
  assert.deepEqual(ticks(scale(false, 0, 1, 0, 1)).map((v) => +v.toFixed(9)), [0, 0.2, 0.4, 0.6, 0.8, 1]);
});

test('numbers have their units', () => {
  assert.equal(shown(0.00123, 's'), '1.23 ms');
  assert.equal(shown(5400, 'Pa'), '5.4 kPa');
  assert.equal(shown(0, 'N'), '0 N');
  assert.equal(shown(NaN, 'N'), '–');
  assert.equal(shown(0.9999, 's', 3), '1 s');
  assert.deepEqual([0, 0.2, 1.25].map((v) => shown(v, '')), ['0', '0.2', '1.25'], 'no unit, no prefix');
});

test('lightness of the colours rises throughout: readable without colour', () => {
  const table = colours();
  const light = (n) => {
    const linear = [0, 1, 2].map((c) => { const v = table[3 * n + c] / 255; return v <= 0.04045 ? v / 12.92 : ((v + 0.055) / 1.055) ** 2.4; });
    return 0.2126 * linear[0] + 0.7152 * linear[1] + 0.0722 * linear[2];
  };
  for (let n = 8; n < 256; n += 8) assert.ok(light(n) > light(n - 8), `at ${n}`);
});

test('what is not known is grey, what is doubted is greyer', () => {
  const table = colours();
  const pixels = coloured(new Float32Array([1, 5, 9, NaN]), (n) => n !== 1, [1, 9], false, table, [100, 100, 100], (n) => (n === 2 ? 0.5 : 0));
  assert.deepEqual([...pixels.slice(4, 7)], [100, 100, 100]);
  assert.deepEqual([...pixels.slice(12, 15)], [100, 100, 100]);
  assert.deepEqual([...pixels.slice(0, 3)], [...table.slice(0, 3)]);
  assert.ok(Math.abs(pixels[8] - (table[765] + 100) / 2) <= 1);
  assert.deepEqual(extent(new Float32Array([3, 1, 2, 100]), (n) => n < 3), [1, 2]);
});

test('the surface follows the tip where they touch, and comes back beside it', () => {
  const tip = { radius: 0.008, flat: 0 }, deep = 0.004;
  assert.equal(pressed(tip, deep, 0), deep);
  assert.equal(pressed(tip, -0.001, 0), 0, 'not in contact');
  for (const off of [0.001, 0.003, 0.005]) assert.ok(Math.abs(pressed(tip, deep, off) - (deep - off * off / 0.016)) < 1e-12);
  const edge = Math.sqrt(0.008 * deep);
  assert.ok(Math.abs(pressed(tip, deep, edge - 1e-9) - pressed(tip, deep, edge + 1e-9)) < 1e-6, 'without a step');
  assert.ok(pressed(tip, deep, 0.05) < 1e-3 * deep * 40);
});

test('the surface that was solved is read between its nodes, and comes back beyond them', () => {
  const array = (...values) => ({ values });
  const surface = { x_m: array(0.01, 0.02, 0.04), z_m: array(-0.001, 0.002), displacement_m: array(1, 3, 5, 10, 30, 50) };
  assert.equal(gaveWay(surface, 0.02, -0.003), 3);
  assert.ok(Math.abs(gaveWay(surface, 0.025, -0.003) - 3.5) < 1e-12);
  assert.equal(gaveWay(surface, 0.02, 0.004), 30, 'the nearest row along z');
  assert.equal(gaveWay(surface, 0.01, 0), 1);
  assert.ok(Math.abs(gaveWay(surface, 0.045, 0) - 2.5) < 1e-9);
  assert.equal(gaveWay(surface, 0.2, 0), 0);
  assert.equal(gaveWay({ x_m: array(), z_m: array(), displacement_m: array() }, 0.02, 0), 0, 'at rest');
});

test('the section shows cells as they are, between where the layer lay and where it has moved', () => {
  const image = { width: 2, height: 4, values: new Uint32Array([11, 21, 12, 22, 13, 23, 14, 24]) };
  const drawn = (from, layer, moved, last = 4) => {
    const out = new Uint32Array(6 * from.length).fill(99);
    section(out, { image, from, layer, last, surface: 2, moved });
    return from.map((_, c) => [0, 1, 2, 3, 4, 5].map((y) => out[y * from.length + c]));
  };
  assert.deepEqual(drawn([0, 1], 0, [2, 2]), [[0, 0, 11, 12, 13, 14], [0, 0, 21, 22, 23, 24]], 'at rest');
  assert.deepEqual(drawn([0], 0, [4]), [[0, 0, 0, 0, 12, 14]], 'pressed together below the finger');
  assert.deepEqual(drawn([0], 0, [1.2]), [[0, 11, 12, 12, 13, 14]], 'risen beside it');
  assert.deepEqual(drawn([1], 2, [3]), [[0, 0, 22, 23, 24, 24]], 'a layer within: what lies above is pressed too');
  assert.deepEqual(drawn([-1, 0], 0, [0, 9]), [[0, 0, 0, 0, 0, 0], [0, 0, 0, 0, 0, 0]], 'beside the tissue, and all of it pushed away');
  assert.deepEqual(drawn([0], 0, [2], 8), [[0, 0, 12, 14, 14, 14]], 'below the map its last cells go on');
});

test('a surface is solved for a finger among its nodes, in its layer', () => {
  const array = (...values) => ({ values }), surface = { depth_m: 0.01, x_m: array(0.01, 0.03) };
  assert.ok(tellsOf(surface, 0.01, 0.02));
  assert.ok(tellsOf(surface, 0.0095, 0.01), 'the service takes the nearest layer');
  assert.ok(!tellsOf(surface, 0, 0.02));
  assert.ok(!tellsOf(surface, 0.01, 0.031));
  assert.ok(tellsOf({ depth_m: 0.01, x_m: array() }, 0.01, 0.5), 'at rest it is so everywhere');
});

test('a cursor reads what is measured, continued or not acquired', () => {
  const map = { origin_m: [0.5, 0.5], spacing_m: [1, 1], modulus_pa: { shape: [1, 3], values: new Float32Array([5000, 6000, 0]) }, valid: { values: new Uint8Array([1, 0, 0]) } };
  assert.match(valueAt(map, [0.5, 0.5]), /: 5 kPa$/);
  assert.match(valueAt(map, [1.5, 0.5]), /not measured, extrapolated: 6 kPa/);
  assert.match(valueAt(map, [2.5, 0.5]), /not acquired/);
  assert.match(valueAt(map, [9, 0.5]), /^x 9000.0 mm, y 500.0 mm$/);
});

test('a cursor reads the cell that it is over', () => {
  const map = { origin_m: [0.5, 0.5], spacing_m: [1, 1], modulus_pa: { shape: [2, 3], values: new Float32Array([1, 2, 3, 4, 5, 6]) } };
  const read = [0.5, 1.5].map((y) => [0.5, 1.5, 2.5].map((x) => valueAt(map, [x, y]).split(': ')[1]));
  assert.deepEqual(read, [['1 Pa', '2 Pa', '3 Pa'], ['4 Pa', '5 Pa', '6 Pa']]);
});

// Stands in for what a browser has, and counts the images that are made.
let made = 0;
globalThis.ImageData = class { constructor(data) { this.data = data; } };
globalThis.document = { createElement: () => {
  const canvas = { getContext: () => ({ putImageData: ({ data }) => { ++made; canvas.pixels = data; } }) };
  return canvas;
} };

test('maps are painted again when they or the colours change, and of B-mode only what is new', () => {
  const mapOf = (...values) => ({ modulus_pa: { values: new Float32Array(values), shape: [1, values.length] },
    valid: { values: new Uint8Array([1, 1, 0]) }, log_std: { values: new Float32Array([0.1, 0.6, 0.1]) } });
  const echo = (drawn, grey) => ({ drawn, shape: [1, 1], values: new Uint8Array([grey]) });
  const first = echo(1, 10), model = { map: mapOf(1e4, 4e4, 9e4), logModulus: false, b_mode: { arrays: [first] } };
  const grey = [128, 128, 128], pixel = (canvas, n) => [...canvas.pixels.slice(4 * n, 4 * n + 3)];
  const painted = paint(model, grey);
  assert.equal(made, 3, 'modulus, deviation, B-mode');
  assert.ok(painted.range[0] <= 1e4 && painted.range[1] > 1e4);
  assert.deepEqual(pixel(painted.modulus, 2), grey, 'not measured');
  assert.notDeepEqual(pixel(painted.modulus, 0), pixel(painted.modulus, 1));
  assert.deepEqual(pixel(painted.bMode[0].canvas, 0), [10, 10, 10]);
  assert.equal(paint(model, grey), painted);
  model.b_mode = { arrays: [first, echo(2, 200)] };
  const more = paint(model, grey);
  assert.equal(made, 6, 'modulus and deviation again, and the new window');
  assert.equal(more.bMode[0].canvas, painted.bMode[0].canvas);
  model.b_mode = { arrays: [echo(3, 90)] };
  assert.deepEqual(pixel(paint(model, grey).bMode[0].canvas, 0), [90, 90, 90], 'imaged anew');
  paintAnew();
  assert.deepEqual(pixel(paint(model, [1, 2, 3]).modulus, 2), [1, 2, 3]);
  const zeros = paint({ ...model, map: { ...mapOf(1e4, 4e4, 9e4), log_std: { values: new Float32Array(3) } } }, grey);
  assert.equal(zeros.states, false);
  assert.deepEqual(pixel(zeros.deviation, 0), grey, '0 is no deviation that is stated');
  assert.deepEqual([{ given: true }, { given: false }].map((w) => given({ windows: [{ given: true }, w] })), [true, false]);
  assert.equal(given(null) || given({ windows: [] }), false);
  assert.deepEqual(paint({ map: null, logModulus: false, b_mode: null }, grey).bMode, []);
});
