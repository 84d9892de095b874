// Scales, ticks, colours and numbers as they are shown. Pure.

const prefixes = [[1e9, 'G'], [1e6, 'M'], [1e3, 'k'], [1, ''], [1e-3, 'm'], [1e-6, 'µ'], [1e-9, 'n']];

export function shown(value, unit, digits = 3) {
  if (!Number.isFinite(value)) return '–';
  if (!unit) return String(Number(value.toPrecision(digits)));  // a prefix stands before a unit alone
  if (value === 0) return `0 ${unit}`;
  const size = Math.abs(value);
  const [factor, prefix] = prefixes.find(([f]) => size >= 0.9995 * f) ?? prefixes.at(-1);
  return `${Number((value / factor).toPrecision(digits))} ${prefix}${unit}`;
}

// Why what stands on the page is not of now; empty: it is, a recording plays, or what is looked at is `past`.
export function whyOld({ open, session, playing, quiet_s, past }) {
  if (past) return '';
  if (!open) return 'teletact-client watch does not answer';
  if (playing) return session ? `the recording: ${session}` : '';  // which says how it broke off, if it did
  if (session !== 'live') return `the session: ${session ?? 'nothing is known of it yet'}`;
  return quiet_s > 1 ? 'no tick comes from the servo loop' : '';
}

// Of what may never have come: such an age or silence is 1e9 s.
export const since = (value_s) => (value_s < 1e8 ? shown(value_s, 's') : 'none yet');

// Why the force is as it is, from a row and the words for its state's reason and its claim. Beyond these limits
// (T5.7, force_chain.h) the servo reduces it; which of them did is not recorded, so all that hold are named.
export function why(row, reason, claim) {
  if (row.state !== 'ENABLED') return reason;
  if (row.faded) return `no answer for ${since(row.at('silence_s'))}: the force fades`;
  const withheld = row.at('withheld'), share = `${(100 * withheld).toFixed(0)} % of the force is withheld`;
  if (!row.degraded) return `${reason}${row.byService ? '; the service doubts its answer' : ''}${withheld >= 0.01 ? ` (${share})` : ''}`;
  const causes = [];
  if (row.debt) causes.push('the display generated energy: the force fades');
  if (withheld > 0.2) causes.push(claim ? `${share}: ${claim}` : share);
  if (!row.byLaw && row.at('model_age_s') > 0.25) causes.push(`the answer is ${since(row.at('model_age_s'))} old: the force is reduced`);
  return causes.join('; ') || 'answers were too old: the force returns slowly';
}

// Where a recording plays, as the status says, and what its button does: at the end it begins again.
export function player({ at_s, length_s, speed, over }) {
  const plays = speed > 0 && !over;
  return { text: `${at_s.toFixed(1)} of ${length_s.toFixed(1)} s`, button: plays ? 'Pause' : 'Play', order: (chosen) => (plays ? { speed: 0 } : over ? { speed: chosen, seek_s: 0 } : { speed: chosen }) };
}

// Values to pixels and back. Logarithmic ones take nothing below `low`.
export function scale(log, low, high, begin, end) {
  const f = log ? Math.log : (v) => v;
  const a = f(low), k = (end - begin) / (f(high) - a);
  const to = (v) => begin + (f(log ? Math.max(v, low) : v) - a) * k;
  const back = log ? (p) => Math.exp(a + (p - begin) / k) : (p) => a + (p - begin) / k;
  return { to, back, low, high, log };
}

export function ticks({ low, high, log }, most = 5) {
  const out = [];
  if (log) {
    for (let decade = Math.ceil(Math.log10(low) - 1e-9); decade <= Math.log10(high) + 1e-9; ++decade) out.push(10 ** decade);
    if (out.length >= 2) return out.filter((_, n) => n % Math.ceil(out.length / most) === 0);
    out.length = 0;
    const first = Math.floor(Math.log10(low));
    for (let decade = first; decade <= Math.log10(high); ++decade)
      for (const m of [1, 2, 5]) if (m * 10 ** decade >= low && m * 10 ** decade <= high) out.push(m * 10 ** decade);
    return out;
  }
  const raw = (high - low) / most;
  const power = 10 ** Math.floor(Math.log10(raw));
  const step = [1, 2, 5, 10].map((m) => m * power).find((s) => s >= raw);
  for (let n = Math.ceil(low / step - 1e-9); n * step <= high + 1e-9 * step; ++n) out.push(n * step);
  return out;
}

// Viridis by a polynomial of degree six: lightness rises throughout, and none of it is told by red against green.
const viridis = [
  [0.2777273272234177, 0.005407344544966578, 0.3340998053353061],
  [0.1050930431085774, 1.404613529898575, 1.384590162594685],
  [-0.3308618287255563, 0.214847559468213, 0.09509516302823659],
  [-4.634230498983486, -5.799100973351585, -19.33244095627987],
  [6.228269936347081, 14.17993336680509, 56.69055260068105],
  [4.776384997670288, -13.74514537774601, -65.35303263337234],
  [-5.435455855934631, 4.645852612178535, 26.3124352495832]];

export function colours(count = 256) {
  const out = new Uint8Array(3 * count);
  for (let n = 0; n < count; ++n) {
    const t = n / (count - 1);
    for (let c = 0; c < 3; ++c) {
      let value = 0;
      for (let power = 6; power >= 0; --power) value = value * t + viridis[power][c];
      out[3 * n + c] = Math.round(255 * Math.min(1, Math.max(0, value)));
    }
  }
  return out;
}

// Between which values a map is shown: what 1 and 99 % of the known ones lie within.
export function extent(values, known) {
  const sorted = [];
  const step = Math.max(1, Math.floor(values.length / 4000));
  for (let n = 0; n < values.length; n += step) if (known(n) && Number.isFinite(values[n])) sorted.push(values[n]);
  if (sorted.length === 0) return null;
  sorted.sort((a, b) => a - b);
  const low = sorted[Math.floor(0.01 * sorted.length)], high = sorted[Math.floor(0.99 * (sorted.length - 1))];
  return high > low ? [low, high] : [low * 0.9 || -1, low * 1.1 || 1];
}

// Pixels of a map: grey where nothing is known; what is known less well is greyer.
export function coloured(values, known, range, log, table, unknown, doubt = () => 0) {
  const out = new Uint8ClampedArray(4 * values.length);
  const along = scale(log, range[0], range[1], 0, 255);
  for (let n = 0; n < values.length; ++n) {
    const good = known(n) && Number.isFinite(values[n]);
    const at = 3 * Math.min(255, Math.max(0, Math.round(good ? along.to(values[n]) : 0)));
    const grey = good ? doubt(n) : 1;
    for (let c = 0; c < 3; ++c) out[4 * n + c] = (good ? table[at + c] : 0) * (1 - grey) + unknown[c] * grey;
    out[4 * n + 3] = 255;
  }
  return out;
}
export const states = ['DISABLED', 'ENABLED', 'PAUSED', 'FAULT'];
export const flags = (bits) => ({
  state: states[bits & 3], byLaw: !!(bits & 4), degraded: !!(bits & 8), byService: !!(bits & 16), faded: !!(bits & 32),
  border: !!(bits & 64), debt: !!(bits & 128) });
