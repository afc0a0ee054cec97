// A second ride beside the one that is shown: where it was at the same time, and how many seconds lie between them.

/** Steps up to which a ride counts as recorded from its start. */
const FRESH = 40;
/** m between the first goals of two rides to the same goals. */
const SAME = 0.5;
/** Worth of a goal in metres of the way: more than any distance. */
const GOAL = 1e5;

/** s around a reached goal. */
const SETTLED = 0.2;

const goalsOf = (marks) => marks.filter(({ kind }) => kind === "active").map(({ x, y }) => [x, y]);

/** How far a ride has come at each of its rows: goals reached, then the distance that is left; it never decreases. */
export function progress(series, marks, from = 0) {
  const reached = marks.filter(({ kind, t }) => kind === "reached" && t >= series.t[from] - 1e-6).map(({ t }) => t);
  const found = new Float64Array(series.length).fill(-Infinity);
  let most = -Infinity;
  let goals = 0;
  for (let index = from; index < series.length; index++) {
    while (goals < reached.length && reached[goals] <= series.t[index]) goals++;
    const left = series.goal_distance[index];
    // Beside the moment of a goal the distance may still be that to the goal before.
    const between = reached.some((t) => Math.abs(t - series.t[index]) < SETTLED);
    if (between) found[index] = most;
    else if (Number.isFinite(left)) most = Math.max(most, GOAL * goals - left);
    else if (goals) most = Math.max(most, GOAL * goals - GOAL / 2);
    found[index] = most;
  }
  return found;
}

/** The first row from `low` on that has come so far; the number of rows where none has. */
function firstAt(done, far, low) {
  let high = done.length;
  while (low < high) {
    const middle = (low + high) >> 1;
    if (done[middle] < far) low = middle + 1;
    else high = middle;
  }
  return low;
}

export class Ghost {
  /** @param {Bag} bag the ride that comes along @param {() => string} paint its policy's colour @param {number} period s of a step */
  constructor(bag, paint, period = 0.025) {
    this.bag = bag;
    this.paint = paint;
    this.period = period;
    this.series = bag.series;
    this.done = progress(bag.series, bag.events);
    this.shift = 0;
  }

  /** The colour of its policy in the scheme that is shown. */
  get colour() {
    return this.paint();
  }

  /** s at step 0 of the episode of a row; the row's own time where its ride was joined later. */
  static zero(series, index, period) {
    let first = index;
    while (first > 0 && series.episode[first - 1] === series.episode[index]) first--;
    return series.step[first] <= FRESH ? series.t[first] - series.step[first] * period : series.t[first];
  }

  /** Takes the moment of the ride that is shown: its rows and the time, s. */
  along(series, index, time) {
    if (index < 0) return;
    this.shift = Ghost.zero(series, index, this.period) - Ghost.zero(this.series, 0, this.period);
    this.time = time - this.shift;
    this.cursor = this.time < this.series.t[0] - 0.5 ? -1 : this.series.indexAt(this.time);
  }

  /**
   * The seconds by which the ride that is shown is behind the ghost (negative: ahead); NaN where they do not ride to the
   * same goal, or the ghost never comes so far.
   *
   * @param marks of the ride that is shown
   */
  gap(series, index, time, marks) {
    const zero = Ghost.zero(series, index, this.period);
    const mine = goalsOf(marks.filter(({ t }) => t >= zero - 0.5))[0];
    const other = goalsOf(this.bag.events)[0];
    if (!mine || !other || Math.hypot(mine[0] - other[0], mine[1] - other[1]) > SAME) return NaN;
    let first = index;
    while (first > 0 && series.episode[first - 1] === series.episode[index]) first--;
    const done = progress(series, marks.filter(({ t }) => t <= time), first);
    const here = done[index];
    if (!Number.isFinite(here)) return NaN;
    // Where it turns and loses ground, what counts is when it had come as far as ever.
    const own = firstAt(done, here, first);
    const others = firstAt(this.done, here, 0);
    if (others >= this.done.length) return NaN;
    return series.t[own] - zero - (this.series.t[others] - Ghost.zero(this.series, 0, this.period));
  }
}

/** The gap in words. */
export function gapWords(gap, name) {
  if (!Number.isFinite(gap)) return `beside ${name}`;
  if (Math.abs(gap) < 0.05) return `level with ${name}`;
  return `${Math.abs(gap).toFixed(1)} s ${gap > 0 ? "behind" : "ahead of"} ${name}`;
}
