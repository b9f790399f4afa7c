// From a pointer's places, in px, to speed, and a stroke that keys move, in mm. Times in ms, speeds per s.

// Shortest time over which a pointer's speed is averaged.
const WINDOW_MS = 20;

// A pointer counts whole pixels, so a slow one is averaged over the time of so many, but at most over LONGEST_MS.
const WINDOW_PX = 12;
const LONGEST_MS = 80;

// The speed of a pointer, from the places that it reports.
class PointerPath {
  constructor() {
    this.begin();
  }

  begin() {
    this.points = [];
  }

  // A place in px at `time`.
  add(time, x, y) {
    const last = this.points.at(-1);
    if (last && time <= last.time) {
      // Two events of one moment: the later place counts, but for the first place of all.
      if (this.points.length > 1) this.points.pop();
      else return;
    }
    const before = this.points.at(-1);
    const way = before ? Math.hypot(x - before.x, y - before.y) : 0;
    this.points.push({ time, x, y, path: (before?.path ?? 0) + way });
    while (this.points.length > 2 && this.points[1].time < time - 3 * LONGEST_MS) this.points.shift();
  }

  // What a place has by `name` at `time`, px: straight between two places, and at rest before the first.
  at(time, name) {
    const { points } = this;
    for (let index = points.length - 1; index > 0; index--) {
      const [from, to] = [points[index - 1], points[index]];
      if (time >= to.time) return to[name];
      if (time > from.time) return from[name] + ((to[name] - from[name]) * (time - from.time)) / (to.time - from.time);
    }
    return points[0]?.[name] ?? 0;
  }

  // Speed at `now`, px/s: the mean over WINDOW_MS up to the last place, or longer for a slow pointer. A pointer that
  // rests reports nothing, so the speed is held for the time in which a place was to come, and falls to zero then.
  speed(now) {
    return this.mean(now, "path");
  }

  // Velocity from left to right at `now`, px/s, in the same way.
  along(now) {
    return this.mean(now, "x");
  }

  mean(now, name) {
    const last = this.points.at(-1);
    if (!last || this.points.length < 2) return 0;
    let window = WINDOW_MS;
    while (window < LONGEST_MS && last.path - this.at(last.time - window, "path") < WINDOW_PX) window += WINDOW_MS / 2;
    const mean = (1000 * (last[name] - this.at(last.time - window, name))) / window;
    const overdue = now - last.time - this.patience();
    return mean * Math.max(0, Math.min(1, 1 - overdue / WINDOW_MS));
  }

  // Time after which the next place is overdue.
  patience() {
    const { points } = this;
    const count = Math.min(4, points.length - 1);
    const interval = count > 0 ? (points.at(-1).time - points.at(-1 - count).time) / count : 0;
    return Math.max(12, Math.min(40, 1.6 * interval));
  }
}

// A tool that keys move back and forth between two ends.
class KeyStroke {
  constructor() {
    this.place = 0.5;
    this.direction = 1;
    // Directions of keys that are held, the last one counts.
    this.held = [];
    this.goesOn = false;
  }

  get moves() {
    return this.goesOn || this.held.length > 0;
  }

  hold(direction) {
    this.held = this.held.filter((other) => other !== direction);
    this.held.push(direction);
    this.direction = direction;
  }

  release(direction) {
    this.held = this.held.filter((other) => other !== direction);
    if (this.held.length > 0) this.direction = this.held.at(-1);
  }

  // Goes on for `ms` at `speed` over a path of `length`, and turns at its ends.
  step(ms, speed, length) {
    this.place += (this.direction * speed * ms) / 1000 / Math.max(1, length);
    if (this.place > 1) [this.place, this.direction] = [Math.max(0, 2 - this.place), -1];
    if (this.place < 0) [this.place, this.direction] = [Math.min(1, -this.place), 1];
  }
}
