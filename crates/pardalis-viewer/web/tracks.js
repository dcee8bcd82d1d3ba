// Tracks as columns that grow, and the times of all of them.

/** The states of a target, in the order of their codes. */
export const STATES = ["searching", "tracking", "occluded", "lost"];

/** What each state means. */
export const MEANINGS = {
  searching: "not found yet",
  tracking: "a camera sees it",
  occluded: "no camera sees it, because something hides it or it has just left the image; its position is predicted",
  lost: "it was found before, but where it is now is not known",
};

const NUMBERS = [
  "time_s", "frame", "x_m", "y_m", "z_m", "vx_mps", "vy_mps", "vz_mps", "heading_rad",
  "xx_m2", "xy_m2", "xz_m2", "yy_m2", "yz_m2", "zz_m2", "confidence", "radius_m", "sigma_radius_m", "sigma_heading_rad",
  "vxx_m2ps2", "vxy_m2ps2", "vxz_m2ps2", "vyy_m2ps2", "vyz_m2ps2", "vzz_m2ps2",
];

/** One target: columns by name, of which the first `length` entries count; missing numbers are NaN. */
export class Track {
  constructor(name) {
    this.name = name;
    this.length = 0;
    /** How far from a time, in seconds, its row may be. */
    this.near_s = 0;
    this.state = new Uint8Array(0);
    for (const column of NUMBERS) this[column] = new Float64Array(0);
  }

  /** Adds rows: columns of numbers or null, and states by name. Columns may be missing. Rows without a time are left out. */
  append(columns) {
    const times = columns.time_s ?? [];
    this.#reserve(this.length + times.length);
    for (let row = 0; row < times.length; row++) {
      if (!Number.isFinite(times[row])) continue;
      for (const name of NUMBERS) {
        this[name][this.length] = columns[name]?.[row] ?? NaN;
      }
      this.state[this.length] = Math.max(0, STATES.indexOf(columns.state?.[row] ?? "tracking"));
      this.length++;
    }
    this.#sort();
  }

  #reserve(length) {
    if (length <= this.state.length) return;
    const capacity = Math.max(length, 2 * this.state.length);
    for (const name of [...NUMBERS, "state"]) {
      const grown = new this[name].constructor(capacity);
      grown.set(this[name]);
      this[name] = grown;
    }
  }

  #sort() {
    const times = this.time_s;
    let row = 1;
    while (row < this.length && times[row - 1] <= times[row]) row++;
    if (row >= this.length) return;
    const order = Array.from({ length: this.length }, (_, index) => index);
    order.sort((a, b) => times[a] - times[b]);
    for (const name of [...NUMBERS, "state"]) {
      const old = this[name].slice(0, this.length);
      order.forEach((from, to) => (this[name][to] = old[from]));
    }
  }

  /** Returns the index of the row at this time, the nearest that is not farther than `near_s`, or −1. */
  rowAt(time_s) {
    const before = this.lastRow(time_s);
    const away_s = (row) => (row >= 0 && row < this.length ? Math.abs(this.time_s[row] - time_s) : Infinity);
    const row = away_s(before) <= away_s(before + 1) ? before : before + 1;
    return away_s(row) <= this.near_s ? row : -1;
  }

  /** Returns the index of the last row that is not after this time, or −1. */
  lastRow(time_s) {
    return lastAtOrBefore(this.time_s, this.length, time_s);
  }

  /** Returns the position of a row, or null. */
  position(row) {
    const place = [this.x_m[row], this.y_m[row], this.z_m[row]];
    return place.every(Number.isFinite) ? place : null;
  }

  /** Returns the index of the last row in which the target was seen, or −1. */
  lastSeen() {
    let row = this.length - 1;
    while (row >= 0 && STATES[this.state[row]] !== "tracking") row--;
    return row;
  }

  /** Whether any row has a value in this column. */
  has(column) {
    const values = this[column];
    for (let row = 0; row < this.length; row++) if (Number.isFinite(values[row])) return true;
    return false;
  }
}

/** All targets, in the order in which they came, and the times that they have rows at. */
export class Tracks {
  constructor() {
    this.all = new Map();
    this.times = [];
    this.frames = [];
  }

  /** Adds rows of targets by name. */
  append(rows) {
    let isLater = true;
    const newest = this.newest();
    const added = new Map();
    for (const [name, columns] of Object.entries(rows)) {
      if (!this.all.has(name)) this.all.set(name, new Track(name));
      this.all.get(name).append(columns);
      (columns.time_s ?? []).forEach((time_s, row) => {
        if (!Number.isFinite(time_s)) return;
        if (!(time_s > newest) && this.times.length > 0) isLater = time_s === newest && isLater;
        if (time_s !== newest || this.times.length === 0) added.set(time_s, columns.frame?.[row] ?? NaN);
      });
    }
    if (!isLater) {
      added.clear();
      for (const track of this.all.values()) {
        for (let row = 0; row < track.length; row++) added.set(track.time_s[row], track.frame[row]);
      }
      this.times = [];
      this.frames = [];
    }
    const times = Float64Array.from(added.keys()).sort();
    for (const time_s of times) {
      this.times.push(time_s);
      this.frames.push(added.get(time_s));
    }
  }

  newest() {
    return this.times.at(-1) ?? NaN;
  }

  /** Returns the usual time between rows, in seconds. */
  step() {
    const { times } = this;
    return times.length < 2 ? 0.04 : (times.at(-1) - times[0]) / (times.length - 1);
  }
}

/** Rows of another run whose times differ by less than this share of the usual step are those of the same time. */
const SAME_TIME = 0.75;

/** Returns the tracks of another run, with rows that are found at the nearest times. */
export function nearbyTracks(rows) {
  const tracks = new Tracks();
  tracks.append(rows);
  for (const track of tracks.all.values()) track.near_s = SAME_TIME * tracks.step();
  return tracks;
}

/** Returns the times of two runs, with their frames: those of the first, and those of the second that the first lacks. */
export function joinedTimes(first, second) {
  const near_s = SAME_TIME * first.step();
  const joined = first.times.map((time_s, at) => [time_s, first.frames[at]]);
  second.times.forEach((time_s, at) => {
    const before = lastAtOrBefore(first.times, first.times.length, time_s);
    const isNear = [before, before + 1].some((index) => Math.abs(first.times[index] - time_s) <= near_s);
    if (!isNear) joined.push([time_s, second.frames[at]]);
  });
  joined.sort((a, b) => a[0] - b[0]);
  return { times: joined.map(([time_s]) => time_s), frames: joined.map(([, frame]) => frame) };
}

/** Returns the index of the last of `length` ascending values that is not above this one, or −1. */
export function lastAtOrBefore(values, length, value) {
  let [low, high] = [0, length];
  while (low < high) {
    const middle = (low + high) >> 1;
    if (values[middle] <= value) low = middle + 1;
    else high = middle;
  }
  return low - 1;
}
