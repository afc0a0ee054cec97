// The ride between its rows: at 40 rows a second, pictures at 60 need the places between them.

/** s that a live picture stays behind the newest row, so that there is a next one to move to. */
const BEHIND = 0.06;
const FARTHEST = 0.6;
const ANGLES = ["heading", "lean", "steer"];
const LENGTHS = ["x", "y", "displacement", "speed"];

const turned = (from, to, share) => from + Math.atan2(Math.sin(to - from), Math.cos(to - from)) * share;

/** The row at a time, s; between two rows what moves is in between. */
export function rowAt(series, time) {
  const index = series.indexAt(time);
  if (index < 0) return null;
  const row = series.row(index);
  if (index + 1 >= series.length || time <= row.t || series.broken(index + 1)) return row;
  const share = Math.min(1, (time - row.t) / (series.t[index + 1] - row.t));
  for (const name of ANGLES) row[name] = turned(row[name], series[name][index + 1], share);
  for (const name of LENGTHS) row[name] += (series[name][index + 1] - row[name]) * share;
  row.t = time;
  return row;
}

/** The time that a live picture shows, which moves on evenly though rows come in bursts. */
export class LiveClock {
  constructor() {
    this.time = NaN;
    this.newest = NaN;
    this.heard = 0;
  }

  /** @param newest s, of the newest row @param now ms @param elapsed s since the last picture */
  at(newest, now, elapsed) {
    if (newest !== this.newest) {
      this.heard = now;
      this.newest = newest;
    }
    const still = now - this.heard > 200;
    const target = newest - (still ? 0 : BEHIND);
    const off = target - this.time;
    if (!(Math.abs(off) < FARTHEST)) this.time = target;
    else if (still) this.time = Math.min(newest, this.time + Math.min(elapsed, Math.max(0, off)));
    else this.time = Math.min(newest, this.time + Math.max(0, elapsed + off * Math.min(1, 3 * elapsed)));
    return this.time;
  }

  /** Whether the next picture shows something else. */
  get moving() {
    return this.time < this.newest;
  }
}
