// The page: what came is kept, drawn once a frame, and then acknowledged.
import { decode } from './decode.js';
import { Series } from './series.js';
import { player, shown, since, why, whyOld } from './layout.js';
import * as panels from './panels.js';

const $ = (id) => document.getElementById(id);
const model = {
  series: new Series(), status: null, scene: null, map: null, tactile: null, windows: null, timeline: null, b_mode: null, surface: null,
  span: 10, back: 0, paused: false, logModulus: true, logTimes: true, from: 0, to: 10, newest: 0, row: null, frozen: 0, largestForce: 1, old: '',
  largest(names, least) {
    let most = least;
    for (const name of names)
      for (let n = this.series.find(this.from); n < this.series.added && this.series.time(n) <= this.to; ++n)
        most = Math.max(most, this.series.value(n, this.series.index[name]));
    return 1.1 * most;
  },
};
// For tests, and for who wants to know.
const measured = { frames: 0, script_ms: [], pose_to_pixel_ms: [], first_ms: null, numbers: {} };
window.teletact = { model, measured };
const keep = (list, value) => { list.push(value); if (list.length > 2000) list.shift(); };
// What is posted while a frame is drawn comes when the browser has painted it: the screen takes it with its next refresh.
const painting = new MessageChannel();
painting.port1.onmessage = ({ data: pose_ms }) => keep(measured.pose_to_pixel_ms, performance.timeOrigin + performance.now() - pose_ms);

// --- what comes --------------------------------------------------------------------------------------------

const live = model.series;  // model.series is another one while the page is paused
let socket = null, waiting = [], dirty = true, era = null, clock = null, begin_s = null, statuses = [], held = [], later = {}, came_ms = 0, failed = false;

function connect() {
  socket = new WebSocket(new URL('live', location.href.replace(/^http/, 'ws')));
  socket.binaryType = 'arraybuffer';
  socket.onmessage = ({ data }) => { waiting.push(data); };
  socket.onclose = () => {
    waiting = [];
    era = null;  // what comes next begins anew
    $('where').textContent = 'teletact-client watch does not answer: trying again';
    setTimeout(connect, 500);
  };
}
const send = (words) => { if (socket?.readyState === WebSocket.OPEN) socket.send(JSON.stringify(words)); };

function take({ slots }) {
  if (slots.trace) {
    const trace = slots.trace;
    if (trace.era !== era) { era = trace.era; live.clear(trace.columns); begin_s = null; statuses = []; }
    if (trace.begin_s) begin_s = trace.begin_s;
    live.add(trace.begin_s, trace.rows.values);
    clock = trace.wall_s - trace.mono_s;
    came_ms = performance.now();
  }
  if (slots.status) {
    if (statuses.at(-1)?.t_s === slots.status.t_s) statuses.pop();
    statuses.push(slots.status);
    while (statuses.length > 1 && statuses[0].t_s < slots.status.t_s - 60) statuses.shift();
    if (!model.paused) showStatus(slots.status);
  }
  if (slots.timeline) { model.timeline = slots.timeline; $('player').hidden = false; }
  if (model.paused) Object.assign(later, slots);
  else takePictures(slots);
}
function takePictures(slots) {
  for (const name of ['scene', 'map', 'tactile', 'b_mode']) if (slots[name]) model[name] = slots[name];
  if (slots.surface) model.surface = slots.surface.x_m ? { ...slots.surface, came: performance.now() } : null;
  if (slots.map || slots.b_mode || slots.scene) panels.pictures.tissue.dirty = true;
  if (slots.windows) { model.windows = slots.windows.windows; showWindows(); }
}

// --- what is shown -----------------------------------------------------------------------------------------

const set = (id, text) => { const at = $(id); if (at.textContent !== text) at.textContent = text; };

const figures = [
  ['felt for', 'enabled_s', (v) => `${v.toFixed(1)} s`], ['answers', 'answers', (v) => String(v)], ['of distinct poses', 'touch_rate_hz', (v) => `${v.toFixed(0)} /s`],
  ['latency p50', 'latency_p50_s', (v) => shown(v, 's')], ['latency p99', 'latency_p99_s', (v) => shown(v, 's')], ['round trip p50', 'round_trip_p50_s', (v) => shown(v, 's')],
  ['by a contact law', 'by_law_share', (v) => `${(100 * v).toFixed(1)} %`], ['stalls', 'stalls', (v, f) => `${v}, ${f.stalls_s.toFixed(3)} s`],
  ['largest force', 'largest_force_n', (v) => shown(v, 'N')], ['interval p95', 'budget_p95', (v) => (v > 0 ? `± ${(100 * v).toFixed(1)} %` : '–')],
  ['force lost', 'lost_s', (v) => `${v.toFixed(2)} s`], ['fading', 'faded_s', (v) => `${v.toFixed(2)} s`], ['DEGRADED', 'degraded_s', (v) => `${v.toFixed(2)} s`],
  ['not covered', 'not_covered', String], ['streams', 'streams', String], ['servo', 'rate_hz', (v) => `${v.toFixed(1)} Hz`],
  ['lateness p99', 'lateness_p99_s', (v) => shown(v, 's')], ['overruns', 'overruns', String]];

function showStatus(status) {
  model.status = status;
  const live = { live: '' }[status.session] ?? status.session ?? (status.playing ? 'a recording' : 'waiting');
  set('where', status.scene ? `scene ${status.scene}${model.scene?.version >= 0 ? `, version ${model.scene.version}` : ''}${live ? ` · session ${live}` : ' · live'}${status.service_state && status.service_state !== 'answers' ? ` · service: ${status.service_state}` : ''}${status.acquire && status.acquire !== 'live' ? ` · patient side: ${status.acquire}` : ''}` : live);
  const numbers = status.figures ?? {};
  measured.numbers = numbers;
  const body = $('figures').tBodies[0];
  figures.forEach(([name, field, say], n) => {
    const row = body.rows[n] ?? body.insertRow();
    if (!row.cells.length) {
      const head = document.createElement('th');
      head.scope = 'row';
      head.textContent = name;
      row.append(head, document.createElement('td'));
      row.cells[1].dataset.field = field;
    }
    const text = field in numbers ? say(Number(numbers[field]), Object.fromEntries(Object.entries(numbers).map(([k, v]) => [k, Number(v)]))) : '–';
    if (row.cells[1].textContent !== text) row.cells[1].textContent = text;
  });
  const lines = status.log ?? [];
  const last = lines.length ? `${lines.length} ${lines.at(-1).t_s} ${begin_s}` : '';
  if ($('log').dataset.last !== last) {
    $('log').dataset.last = last;
    $('log').replaceChildren(...[...lines].reverse().map((line) => {
      const item = document.createElement('li');
      item.dataset.at = line.t_s;
      if (line.warning) item.className = 'warns';
      item.textContent = `${begin_s === null ? '' : `${Math.max(0, line.t_s - begin_s).toFixed(1)} s  `}${line.warning ? '! ' : ''}${line.text}`;
      return item;
    }));
  }
  set('interval-by', status.answer?.largest_term ?? '–');
  const warning = status.answer?.warning ?? '';
  $('warning').hidden = !warning;
  set('warning', warning);
  showFaults(status.faults === true && status.session === 'live');
  if (status.playing) {
    const { text, button } = player(status.playing);
    set('played', text);
    set('play', button);
    $('seek').max = status.playing.length_s;  // before the value, which must lie within
    if (document.activeElement !== $('seek')) $('seek').value = status.playing.at_s;
  }
}

const noWindows = $('windows').firstElementChild;
const stages = ['received', 'displacement', 'strain', 'modulus', 'published'];
function showWindows() {
  const shownWindows = [...(model.windows ?? [])].reverse().filter((w) => w.origin_m);
  if (!shownWindows.length) return $('windows').replaceChildren(noWindows);
  $('windows').replaceChildren(...shownWindows.map((w) => {
    const line = document.createElement('div');
    line.className = 'window';
    const solid = w.origin_m[2] ? `z ${(1e3 * w.origin_m[2]).toFixed(0)} mm` : `x ${(1e3 * w.origin_m[0]).toFixed(0)} mm`;
    const bar = document.createElement('span');
    bar.className = 'stages';
    const done = stages.indexOf(w.stage);
    bar.setAttribute('role', 'img');
    bar.setAttribute('aria-label', `stage: ${w.stage}`);
    stages.forEach((_, n) => { const part = document.createElement('i'); part.className = n <= done ? 'done' : n === done + 1 ? 'now' : ''; bar.append(part); });
    const name = document.createElement('span'), said = document.createElement('span');
    name.textContent = solid;
    said.textContent = w.stage === 'published' ? shown(w.service_s, 's') : w.stage === 'not published' ? w.stage : `after ${w.stage}`;
    line.append(name, bar, said);
    for (const warning of w.warnings ?? []) { const small = document.createElement('small'); small.textContent = `doubtful: ${warning}`; line.append(small); }
    return line;
  }));
}

const faults = [['stall', 'Stall 1 s'], ['jitter', 'Jitter'], ['far', '200 ms away'], ['cut', 'Cut the link'], ['kill', 'Kill the service'],
  ['force', 'Wrong force sensor'], ['decorrelated', 'Decorrelated frame'], ['none', 'Restore the link']];
function showFaults(any) {
  const bar = $('faults');
  if (bar.hidden === !any) return;
  bar.hidden = !any;
  bar.replaceChildren(...faults.map(([word, name]) => {
    const button = document.createElement('button');
    button.textContent = name;
    button.dataset.fault = word;
    button.onclick = () => send({ fault: word });
    return button;
  }));
}

const marks = { OLD: '–', ENABLED: '●', PAUSED: '❚❚', FAULT: '✕', DISABLED: '○', DEGRADED: '◐' };
const claim = (row) => (row.at('claim') > 0 ? `${model.status?.claims?.[row.at('claim')] ?? 'a claim'} needs ${shown(row.at('claim_lacks_j'), 'J')} more` : '');
function showNow(row) {
  const state = model.old ? 'OLD' : panels.stateName(row);
  $('state').dataset.state = $('now').dataset.state = state;
  set('state-mark', marks[state]);
  set('state-name', state);
  const reason = model.status?.reasons?.[row.at('reason')] ?? '';
  set('state-reason', model.old ? `${model.old}; these are the last values` : why(row, reason, claim(row)));
  set('force-now', `${row.size.toFixed(3)} N${row.size > 0 ? panels.interval(row, 0) : ''}`);
  const path = model.status?.answer?.path;
  set('rendered-now', row.state !== 'ENABLED' ? 'nothing' : row.byLaw ? 'contact law' : `answers${path && path !== 'UNSPECIFIED' ? `, ${path.toLowerCase()}` : ''}`);
  set('age-now', since(row.at('model_age_s')));
  set('round-now', row.at('round_trip_s') > 0 ? shown(row.at('round_trip_s'), 's') : '–');
  set('silence-now', since(row.at('silence_s')));
  set('energy-now', `${shown(row.at('balance_j'), 'J')}${claim(row) && `; ${claim(row)}`}`);
  set('modulus-now', row.at('modulus_age_s') > 0 ? shown(row.at('modulus_age_s'), 's') : '–');
}

function draw() {
  const { series } = model;
  model.newest = series.count ? series.time(series.added - 1) : 0;
  model.to = model.paused ? model.frozen + model.back : model.newest;
  model.from = model.to - model.span;
  const n = series.count ? series.at(model.to) : -1;
  model.row = n >= 0 ? panels.row(series, n) : null;
  if (model.row) showNow(model.row);
  for (const [name, paint] of [['tissue', panels.tissue], ['close', panels.close], ['force', panels.force], ['ages', panels.ages], ['servo', panels.servo], ['tactile', panels.tactile]]) {
    const picture = panels.pictures[name];
    if (name !== 'tactile' && (picture.measured < 100 || (!picture.visible && picture.width))) continue;  // no room, or not seen
    if (series.count || name === 'tissue') paint(model, model.row);
  }
  if (model.timeline) panels.timeline($('timeline'), model);
}

function frame() {
  requestAnimationFrame(frame);
  const begin = performance.now();
  const messages = waiting;
  waiting = [];
  let painted = 0;
  try {
    for (const message of messages) { const one = decode(message); painted = one.number; take(one); }
    const newest = statuses.at(-1) ?? model.status;  // while the page is paused, too
    const old = whyOld({ open: socket.readyState === WebSocket.OPEN, session: newest?.session, playing: newest?.playing, quiet_s: (begin - came_ms) / 1e3, past: model.paused && model.back < 0 });
    if (old !== model.old) { model.old = old; dirty = true; }
    const moved = Object.values(panels.pictures).some((p) => p.dirty);
    if (!messages.length && !dirty && !moved) return;
    dirty = false;
    draw();
  } catch (error) {  // the next frame may do
    if (!failed) console.error(error);  // once: there are 60 frames a second
    failed = true;
    set('where', `this page failed: ${error.message}`);
  }
  if (painted) {
    send({ painted });
    ++measured.frames;
    keep(measured.script_ms, performance.now() - begin);
    if (measured.first_ms === null && model.map) measured.first_ms = performance.now();
    if (model.series.count && !model.paused && clock !== null && model.status?.session === 'live')
      painting.port2.postMessage(1e3 * (model.newest + clock));
  }
}

// --- what a person does ------------------------------------------------------------------------------------

function pause(on) {
  if (on === model.paused) return;
  model.paused = on;
  model.series = on ? live.copy() : live;
  held = statuses.slice();
  if (!on) { takePictures(later); later = {}; }
  model.frozen = model.newest;
  model.back = 0;
  $('pause').setAttribute('aria-pressed', String(on));
  set('pause', on ? 'Live' : 'Pause');
  $('scroll-row').hidden = !on;
  $('scroll').value = 0;
  scroll(0);
  if (!on && statuses.length) showStatus(statuses.at(-1));
}
function scroll(by) {
  model.back = Math.max(-60, Math.min(0, by));
  $('scroll').value = model.back;
  set('scrolled', model.back === 0 ? 'when paused' : `${model.back.toFixed(1)} s`);
  const then = model.frozen + model.back;
  if (model.paused) { const status = model.back === 0 ? held.at(-1) : held.findLast((s) => s.t_s <= then); if (status) showStatus(status); }
  dirty = true;
}
function toggle(id, name) {
  model[name] = !model[name];
  $(id).setAttribute('aria-pressed', String(model[name]));
  panels.repaint();
  dirty = true;
}
function theme(name) {
  document.documentElement.dataset.theme = name;
  set('theme', name === 'dark' ? 'light' : 'dark');
  panels.repaint();
  dirty = true;
}
function save(blob, name) {
  const link = document.createElement('a');
  link.href = URL.createObjectURL(blob);
  link.download = name;
  link.click();
  setTimeout(() => URL.revokeObjectURL(link.href), 10000);
}
function png() {
  const shownPictures = Object.entries(panels.pictures).filter(([, p]) => p.width && p.canvas.offsetParent);
  const canvas = document.createElement('canvas');
  const gap = 30, ratio = shownPictures[0][1].ratio;
  canvas.width = Math.max(...shownPictures.map(([, p]) => p.canvas.width)) + 2 * gap;
  canvas.height = shownPictures.reduce((sum, [, p]) => sum + p.canvas.height + gap, gap);
  const pen = canvas.getContext('2d'), style = getComputedStyle(document.documentElement);
  pen.fillStyle = style.getPropertyValue('--panel');
  pen.fillRect(0, 0, canvas.width, canvas.height);
  pen.fillStyle = style.getPropertyValue('--ink');
  pen.font = `${12 * ratio}px sans-serif`;
  let y = gap;
  for (const [name, p] of shownPictures) {
    pen.fillText(`${name}: ${p.said ?? ''}`, gap, y - 6);
    pen.drawImage(p.canvas, gap, y);
    y += p.canvas.height + gap;
  }
  canvas.toBlob((blob) => save(blob, 'teletact.png'));
}

$('pause').onclick = () => pause(!model.paused);
$('scroll').oninput = () => scroll(Number($('scroll').value));
$('span').onchange = () => { model.span = Number($('span').value); dirty = true; };
$('log-modulus').onclick = () => toggle('log-modulus', 'logModulus');
$('log-times').onclick = () => toggle('log-times', 'logTimes');
$('theme').onclick = () => theme(document.documentElement.dataset.theme === 'dark' ? 'light' : 'dark');
$('png').onclick = png;
$('csv').onclick = () => save(new Blob([model.series.csv(model.from, model.to)], { type: 'text/csv' }), 'teletact.csv');
$('play').onclick = () => { if (model.status?.playing) send(player(model.status.playing).order(Number($('speed').value))); };
$('speed').onchange = () => send({ speed: Number($('speed').value) });
const seek = (seek_s) => { pause(false); send({ seek_s }); };
$('seek').onchange = () => { seek(Number($('seek').value)); $('seek').blur(); };
$('timeline').onclick = (event) => seek((event.offsetX / $('timeline').clientWidth) * model.timeline.length_s);
document.addEventListener('visibilitychange', () => { came_ms = performance.now(); });  // hidden, nothing comes
document.addEventListener('keydown', (event) => {
  if (event.ctrlKey || event.metaKey || event.altKey || /INPUT|SELECT/.test(event.target.tagName)) return;
  if (event.key === ' ' && event.target.tagName !== 'BUTTON') { pause(!model.paused); event.preventDefault(); }
  if (event.key === 'l') toggle('log-modulus', 'logModulus');
  if (event.key === 't') toggle('log-times', 'logTimes');
  if (event.key === 'ArrowLeft' || event.key === 'ArrowRight') {
    if (!model.paused) pause(true);
    scroll(model.back + (event.key === 'ArrowLeft' ? -0.5 : 0.5));
  }
});
theme(matchMedia('(prefers-color-scheme: dark)').matches ? 'dark' : 'light');
connect();
requestAnimationFrame(frame);
