// What an estimator made of the sensors, beside the truth: its columns of the rows, as rows of their own.

import { Series } from "./series.js";

const COLUMNS = { x: "est_x", y: "est_y", heading: "est_heading", lean: "est_lean", steer: "est_steer", speed: "est_speed" };
/** Strip charts that have a second line, and the column of it. */
export const ESTIMATED = { lean: "est_lean", steer: "est_steer", speed: "est_speed" };

/** The estimates of a ride; they grow with its rows. */
export class Estimate extends Series {
  constructor(series) {
    super([]);
    this.truth = series;
    this.columns = ["t", ...Object.keys(COLUMNS), "displacement", "policy", "episode"];
    this.data = this.columns.map((name) => series[name === "t" ? "est_t" : COLUMNS[name] ?? name]);
    for (const [index, name] of this.columns.entries()) this[name] = this.data[index];
  }

  /** Whether there is an estimate in a row of the ride. */
  known(index) {
    return index >= 0 && Number.isFinite(this.x[index]);
  }

  /** Whether there is one in some of the rows from `first` to `last`. */
  within(first, last) {
    for (let index = last; index >= first; index--) if (this.known(index)) return true;
    return false;
  }

  broken(index) {
    return super.broken(index) || !this.known(index) || !this.known(index - 1);
  }
}

const made = new WeakMap();

/** The estimates of a ride; null where it has no such columns. */
export function estimateOf(series) {
  if (!series.est_t) return null;
  if (!made.has(series)) made.set(series, new Estimate(series));
  return made.get(series);
}

/** How far the estimate of a row is from the truth at its time: lean (rad) and place (m); NaN without one. */
export function offBy(series, index) {
  if (!Number.isFinite(series.est_x?.[index])) return { lean: NaN, place: NaN };
  const at = series.indexAt(series.est_t[index] + 1e-6);
  const place = Math.hypot(series.est_x[index] - series.x[at], series.est_y[index] - series.y[at]);
  return { lean: series.est_lean[index] - series.lean[at], place };
}
