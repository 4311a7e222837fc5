// All that is known of a race, by time. A live page adds to it, a replay has it whole.

export const COLUMNS = [
  "time", "x", "y", "z", "qw", "qx", "qy", "qz", "speed", "thrust", "error",
];
const N = COLUMNS.length;
// What changes now and then: lists of objects with a time `t` (s).
const LISTS = ["events", "status", "crossings", "plans", "maps", "pictures", "shifts",
  "estimates"];
const MOST_PICTURES = 4000; // that a page keeps

// Returns the 32-bit numbers that a text holds in base64.
export function decodeFloats(text) {
  const bytes = Uint8Array.from(atob(text), (c) => c.charCodeAt(0));
  return new Float32Array(bytes.buffer);
}

// Returns how many objects of a sorted list have a time of at most t.
export function countUntil(list, t) {
  let low = 0, high = list.length;
  while (low < high) {
    const middle = (low + high) >> 1;
    if (list[middle].t <= t) low = middle + 1;
    else high = middle;
  }
  return low;
}

export function last(list, t) {
  return list[countUntil(list, t) - 1];
}

export class Timeline {
  constructor() {
    this.frames = new Float32Array(N * 1024);
    this.count = 0; // of frames
    this.over = null; // how the race ended
    for (const name of LISTS) this[name] = [];
  }

  // Takes in a batch, as race_record.py makes it.
  add(batch) {
    if (batch.frames) this.addFrames(decodeFloats(batch.frames));
    for (const name of LISTS) if (batch[name]) this.append(name, batch[name]);
    if (this.pictures.length > MOST_PICTURES) {
      this.pictures = this.pictures.filter((_, i) => i % 2 === 0);
    }
    if (batch.over) this.over = batch.over;
  }

  // A crossing is told a little later than what was seen at once: lists are kept by time.
  append(name, more) {
    this[name].push(...more);
    this[name].sort((a, b) => a.t - b.t);
  }

  addFrames(rows) {
    const size = this.count * N + rows.length;
    if (size > this.frames.length) {
      const larger = new Float32Array(2 * size);
      larger.set(this.frames.subarray(0, this.count * N));
      this.frames = larger;
    }
    this.frames.set(rows, this.count * N);
    this.count = size / N;
  }

  get start() {
    return this.count ? this.frames[0] : 0;
  }

  // When the last thing happened: an event may be told after the last frame.
  get end() {
    const frame = this.count ? this.frames[(this.count - 1) * N] : 0;
    return Math.max(frame, this.events.at(-1)?.t ?? 0);
  }

  // Returns the index of the last frame until t, at least 0.
  index(t) {
    let low = 0, high = this.count;
    while (low < high) {
      const middle = (low + high) >> 1;
      if (this.frames[middle * N] <= t) low = middle + 1;
      else high = middle;
    }
    return Math.max(low - 1, 0);
  }

  row(i) {
    return this.frames.subarray(i * N, (i + 1) * N);
  }

  // Returns the drone's state at a time, between two frames: position p (m), quaternion q as
  // x, y, z, w, speed (m/s), thrust (weights) and error of its estimate (m).
  sample(t) {
    if (!this.count) return null;
    const i = this.index(t), a = this.row(i), b = this.row(Math.min(i + 1, this.count - 1));
    const span = b[0] - a[0], s = span > 0 ? Math.min(Math.max((t - a[0]) / span, 0), 1) : 0;
    const mixed = (k) => a[k] + s * (b[k] - a[k]);
    // The same rotation has two quaternions: take the nearer.
    const sign = a[4] * b[4] + a[5] * b[5] + a[6] * b[6] + a[7] * b[7] < 0 ? -1 : 1;
    const q = [5, 6, 7, 4].map((k) => a[k] + s * (sign * b[k] - a[k]));
    const norm = Math.hypot(...q) || 1;
    return {
      t,
      p: [mixed(1), mixed(2), mixed(3)],
      q: q.map((each) => each / norm),
      speed: mixed(8),
      thrust: mixed(9),
      error: mixed(10),
    };
  }
}

// Returns a vector of the body in the axes of the world, for a quaternion x, y, z, w.
export function rotated([x, y, z, w], [a, b, c]) {
  const u = 2 * (y * c - z * b), v = 2 * (z * a - x * c), t = 2 * (x * b - y * a);
  return [a + w * u + y * t - z * v, b + w * v + z * u - x * t, c + w * t + x * v - y * u];
}
