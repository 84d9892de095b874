// Pictures on canvases: sizes, axes, traces and maps.
import { shown, ticks } from './layout.js';

let palette = {};
export function readPalette() {
  const style = getComputedStyle(document.documentElement);
  for (const name of ['back', 'panel', 'ink', 'soft', 'line', 'grid', 'blue', 'orange', 'green', 'violet', 'grey', 'unknown', 'good', 'wait', 'bad'])
    palette[name] = style.getPropertyValue(`--${name}`).trim();
  return palette;
}
export const rgb = (hex) => [1, 3, 5].map((at) => parseInt(hex.slice(at, at + 2), 16));

// A canvas as large as it is shown, its height given; drawn in CSS pixels.
export class Picture {
  constructor(id) {
    this.canvas = document.getElementById(id);
    this.read = document.getElementById(`${id}-read`);
    this.cursor = null;
    this.width = this.height = 0;
    this.visible = true;
    new IntersectionObserver(([seen]) => { this.visible = seen.isIntersecting; this.dirty = true; }).observe(this.canvas);
    const measure = () => { this.measured = this.canvas.clientWidth; this.dirty = true; };
    new ResizeObserver(measure).observe(this.canvas);
    measure();
    this.canvas.addEventListener('pointermove', (event) => { this.cursor = [event.offsetX, event.offsetY]; this.dirty = true; });
    this.canvas.addEventListener('pointerleave', () => { this.cursor = null; this.dirty = true; });
    this.canvas.addEventListener('blur', () => { this.cursor = null; this.dirty = true; });
    this.canvas.addEventListener('keydown', (event) => {
      const step = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, -1], ArrowDown: [0, 1] }[event.key];
      if (!step) return;
      const [x, y] = this.cursor ?? [this.width / 2, this.height / 2];
      const by = event.shiftKey ? 20 : 4;
      this.cursor = [Math.min(this.width, Math.max(0, x + by * step[0])), Math.min(this.height, Math.max(0, y + by * step[1]))];
      this.dirty = true;
      event.preventDefault();
      event.stopPropagation();
    });
  }
  begin(height) {
    const ratio = Math.min(window.devicePixelRatio || 1, 2);
    if (this.width !== this.measured || this.height !== height || this.ratio !== ratio) {
      [this.width, this.height, this.ratio] = [this.measured, height, ratio];
      this.canvas.width = Math.round(this.width * ratio);
      this.canvas.height = Math.round(height * ratio);
      this.canvas.style.height = `${height}px`;
      this.pen = this.canvas.getContext('2d', { alpha: false });
    }
    this.dirty = false;
    return this.cleared(this.pen);
  }
  cleared(pen) {
    pen.setTransform(this.ratio, 0, 0, this.ratio, 0, 0);
    pen.fillStyle = palette.panel;
    pen.fillRect(0, 0, this.width, this.height);
    pen.font = '11px system-ui, "DejaVu Sans", sans-serif';
    pen.lineWidth = 1;
    return pen;
  }
  say(text) {
    if (this.said === text) return;
    this.said = text;
    if (this.read) this.read.textContent = text;
  }
  label(text) {
    if (this.labelled === text) return;
    this.labelled = text;
    this.canvas.setAttribute('aria-label', text);
  }
}

// What of a picture stays as it is from frame to frame.
export class Still {
  constructor() {
    this.canvas = document.createElement('canvas');
    this.key = [];
  }
  // Drawn by `paint`, again when one of `key` or the picture's size is another.
  onto(picture, key, paint) {
    const now = [picture.canvas.width, picture.canvas.height, ...key];
    if (now.length !== this.key.length || now.some((value, n) => value !== this.key[n])) {
      this.key = now;
      this.canvas.width = picture.canvas.width;
      this.canvas.height = picture.canvas.height;
      paint(picture.cleared(this.canvas.getContext('2d', { alpha: false })));
    }
    picture.pen.drawImage(this.canvas, 0, 0, picture.canvas.width / picture.ratio, picture.canvas.height / picture.ratio);
  }
}

// Pixels that are written one by one, as an image.
export class Pixels {
  constructor() {
    this.at = document.createElement('canvas');
  }
  shape(width, height) {
    if (this.data && this.data.width === width && this.data.height === height) return;
    this.at.width = width;
    this.at.height = height;
    this.pen = this.at.getContext('2d');
    this.data = this.pen.createImageData(width, height);
    this.pixels = new Uint32Array(this.data.data.buffer);
  }
  canvas() {
    this.pen.putImageData(this.data, 0, 0);
    return this.at;
  }
}

export function yAxis(pen, scaled, box, unit) {
  pen.textAlign = 'right';
  pen.textBaseline = 'middle';
  for (const value of ticks(scaled, 4)) {
    const y = Math.round(scaled.to(value)) + 0.5;
    pen.strokeStyle = palette.grid;
    pen.beginPath(); pen.moveTo(box.left, y); pen.lineTo(box.right, y); pen.stroke();
    pen.fillStyle = palette.soft;
    pen.fillText(shown(value, unit), box.left - 6, y);
  }
}

export function timeAxis(pen, from, to, newest, box) {
  pen.textAlign = 'center';
  pen.textBaseline = 'top';
  const span = to - from;
  for (const ago of ticks({ low: from - newest, high: to - newest }, 6)) {
    const x = box.left + ((newest + ago - from) / span) * (box.right - box.left);
    pen.fillStyle = palette.soft;
    pen.fillText(Math.abs(ago) < 1e-9 ? 'now' : `${Number(ago.toFixed(2))} s`, x, box.bottom + 5);
    pen.strokeStyle = palette.grid;
    pen.beginPath(); pen.moveTo(x, box.top); pen.lineTo(x, box.bottom); pen.stroke();
  }
}

// A column of the series between two times.
export function trace(pen, series, column, from, to, box, scaled, colour) {
  const pixels = Math.max(1, Math.floor(box.right - box.left));
  if (!trace.low || trace.low.length !== pixels) { trace.low = new Float32Array(pixels); trace.high = new Float32Array(pixels); }
  const { low, high } = trace;
  series.extremes(column, from, to, pixels, low, high);
  pen.strokeStyle = colour;
  pen.lineWidth = 1.6;
  pen.beginPath();
  let gap = Infinity;
  const most = Math.max(3, (0.08 / (to - from)) * pixels);  // no row for so long: the line breaks
  for (let x = 0; x < pixels; ++x) {
    if (Number.isNaN(low[x])) { ++gap; continue; }
    const y = scaled.to(high[x]);
    if (gap > most) pen.moveTo(box.left + x, y); else pen.lineTo(box.left + x, y);
    if (low[x] !== high[x]) pen.lineTo(box.left + x, scaled.to(low[x]));
    gap = 0;
  }
  pen.stroke();
  pen.lineWidth = 1;
}

// The interval of 95 in 100 around the force, where it is stated.
export function band(pen, series, force, half, above, from, to, box, scaled, colour) {
  pen.fillStyle = colour;
  pen.globalAlpha = 0.25;
  const scaleX = (box.right - box.left) / (to - from);
  const first = series.find(from), step = Math.max(1, Math.floor((series.added - first) / 700));
  let upper = [], lower = [];
  const close = () => {
    if (upper.length > 1) {
      pen.beginPath();
      upper.forEach(([x, y], n) => (n ? pen.lineTo(x, y) : pen.moveTo(x, y)));
      lower.reverse().forEach(([x, y]) => pen.lineTo(x, y));
      pen.fill();
    }
    upper = []; lower = [];
  };
  for (let n = first; n < series.added && series.time(n) <= to; n += step) {
    const width = half(n), middle = force(n);
    if (Number.isNaN(width)) { close(); continue; }
    const x = box.left + (series.time(n) - from) * scaleX;
    upper.push([x, scaled.to(middle + (width + above(n)) * Math.abs(middle))]);
    lower.push([x, scaled.to(middle - width * Math.abs(middle))]);
  }
  close();
  pen.globalAlpha = 1;
}

export function legend(pen, box, entries) {
  pen.textAlign = 'left';
  pen.textBaseline = 'middle';
  let x = box.left + 6, y = box.top + 9;
  for (const [name, colour] of entries) {
    const width = 28 + pen.measureText(name).width;
    if (x > box.left + 6 && x + width > box.right) { x = box.left + 6; y += 15; }
    pen.fillStyle = colour;
    pen.fillRect(x, y - 2, 12, 3);
    pen.fillStyle = palette.ink;
    pen.fillText(name, x + 16, y);
    x += width;
  }
}

export function image(pixels, width, height) {
  const canvas = document.createElement('canvas');
  canvas.width = width;
  canvas.height = height;
  canvas.getContext('2d').putImageData(new ImageData(pixels, width, height), 0, 0);
  return canvas;
}

export function colourBar(pen, box, scaled, table, unit) {
  const height = box.bottom - box.top;
  for (let y = 0; y < height; ++y) {
    const at = 3 * Math.round(255 * (1 - y / height));
    pen.fillStyle = `rgb(${table[at]},${table[at + 1]},${table[at + 2]})`;
    pen.fillRect(box.left, box.top + y, 10, 1.5);
  }
  pen.fillStyle = palette.soft;
  pen.textAlign = 'left';
  pen.textBaseline = 'middle';
  for (const value of ticks(scaled, Math.max(2, Math.floor(height / 26)))) pen.fillText(shown(value, unit), box.left + 14, scaled.to(value));
}
