// The last minute of rows, by time. Pure.

export class Series {
  constructor(capacity = 6400) {
    this.capacity = capacity;
    this.clear([]);
  }
  clear(columns) {
    this.columns = columns;
    this.index = Object.fromEntries(columns.map((name, n) => [name, n]));
    this.width = columns.length;
    this.times = new Float64Array(this.capacity);
    this.rows = new Float32Array(this.capacity * this.width);
    this.added = 0;
  }
  copy() {
    const out = Object.assign(new Series(0), this);
    out.times = this.times.slice();
    out.rows = this.rows.slice();
    return out;
  }
  get count() { return Math.min(this.added, this.capacity); }
  get first() { return this.added - this.count; }
  // Rows of the gateway: times in their first column, since `begin`.
  add(begin, rows) {
    for (let at = 0; at + this.width <= rows.length; at += this.width) {
      const place = this.added++ % this.capacity;
      this.times[place] = begin + rows[at];
      this.rows.set(rows.subarray(at, at + this.width), place * this.width);
    }
  }
  time(n) { return this.times[n % this.capacity]; }
  value(n, column) { return this.rows[(n % this.capacity) * this.width + column]; }
  // The number of the first row at `time` or later.
  find(time) {
    let low = this.first, high = this.added;
    while (low < high) {
      const middle = (low + high) >> 1;
      if (this.time(middle) < time) low = middle + 1; else high = middle;
    }
    return low;
  }
  // The row that holds at `time`; -1: none.
  at(time) {
    const next = this.find(time);
    if (next < this.added && this.time(next) === time) return next;
    return next > this.first ? next - 1 : -1;
  }
  // For each of `pixels` from `from` to `to`: the least and the largest of a column, NaN where nothing is.
  extremes(column, from, to, pixels, low, high) {
    low.fill(NaN); high.fill(NaN);
    const scale = pixels / (to - from);
    for (let n = this.find(from); n < this.added; ++n) {
      const x = Math.floor((this.time(n) - from) * scale);
      if (x >= pixels) break;
      const value = this.value(n, column);
      if (!(low[x] <= value)) low[x] = value;
      if (!(high[x] >= value)) high[x] = value;
    }
  }
  csv(from, to) {
    const lines = [this.columns.join(',')];
    for (let n = this.find(from); n < this.added && this.time(n) <= to; ++n) {
      const cells = [this.time(n).toFixed(4)];
      for (let column = 1; column < this.width; ++column) {
        const value = this.value(n, column);
        cells.push(Number.isNaN(value) ? '' : String(+value.toPrecision(7)));
      }
      lines.push(cells.join(','));
    }
    return lines.join('\n') + '\n';
  }
}
