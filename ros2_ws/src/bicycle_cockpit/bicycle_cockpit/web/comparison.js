// A second ride beside the one that is shown, and the live bicycle's race against it.

import { answer } from "./controls.js";
import { Ghost, gapWords } from "./ghost.js";
import { addToPalette, colourOf } from "./palette.js";
import { RIDES } from "./source.js";
import { colours } from "./theme.js";
import { asked } from "./views.js";
import { labelOf } from "./who.js";

const byId = (id) => document.getElementById(id);

/** ms between two computations of the gap. */
const GAP_EVERY = 150;
/** m from the origin up to which a ride began there. */
const AT_ORIGIN = 0.05;
const MOST_GOALS = 50;

export class Comparison {
  /**
   * @param {BagPlayer} player
   * @param {Live} live
   * @param {(type: string, fields: object) => Promise<void>} ask sends a request to the cockpit
   * @param {() => void} changed
   */
  constructor(player, live, ask, changed) {
    Object.assign(this, { player, live, ask, changed });
    this.ghost = null;
    /** Controllers that the cockpit can let ride a bag again: those that come along with it. */
    this.controllers = [];
    this.gap = NaN;
    this.gapAt = 0;
  }

  /** Lets a person choose the second ride; takes it away where there is one. */
  async choose() {
    const { player } = this;
    if (this.ghost) return this.beside(null);
    const again = player.bag && !RIDES ? this.controllers : [];
    await player.choose(async (name, rider, label) => {
      const bag = await player.read(name, rider, label);
      if (!bag) return;
      this.beside(bag);
      if (bag.misfit) answer({ ok: false, message: `${labelOf(bag.riders[0])} does not suit this ride: ${bag.misfit}` });
      if (!player.bag) this.race(bag);
    }, player.bag ? "A ride to compare with" : "A ride to race against", again);
  }

  /** Sends the live bicycle on the ride of its ghost: the same start and the same goals. */
  async race(bag) {
    const { x, y, heading } = bag.series;
    if (![x[0], y[0], heading[0]].every((value) => Math.abs(value) < AT_ORIGIN)) {
      return answer({ ok: true, message: `${bag.name} began elsewhere: send goals, and it rides along from step 0.` });
    }
    const points = bag.events.filter(({ kind }) => kind === "active").map((one) => [one.x, one.y]).slice(0, MOST_GOALS);
    await this.ask("reset", { random: false });
    if (points.length) await this.ask("waypoints", { points });
    answer({ ok: true, message: `Race against ${bag.name}: the same start, the same ${points.length} goals.` });
  }

  /** Shows a bag beside the ride; null takes it away. */
  beside(bag) {
    const rider = bag?.riders[0];
    addToPalette(bag?.slots ?? []);
    this.ghost = bag && new Ghost(bag, () => (rider ? colourOf(rider) : colours.soft), this.live.facts.time_step ?? 0.025);
    for (const id of ["compare", "race"]) {
      byId(id).setAttribute("aria-pressed", String(Boolean(this.ghost)));
      byId(id).textContent = this.ghost ? "No ghost" : id === "compare" ? "Compare…" : "Ghost…";
    }
    this.changed();
  }

  /** Brings the ghost to the moment that is shown and returns it; null without one. */
  at({ series, cursor, marks }, time) {
    const { ghost, player } = this;
    if (!ghost || cursor < 0) return null;
    ghost.along(series, cursor, time);
    const now = performance.now();
    if (now - this.gapAt < GAP_EVERY && !asked("film")) return ghost;
    this.gapAt = now;
    this.gap = ghost.gap(series, cursor, time, player.bag ? player.bag.events : marks);
    return ghost;
  }

  /** The gap in words; empty without a ghost. */
  get words() {
    const { ghost } = this;
    return ghost ? gapWords(this.gap, ghostName(ghost.bag)) : "";
  }
}

/** Who the ghost is, and whether it was made for such a ride. */
function ghostName(bag) {
  const name = labelOf(bag.riders[0]) || bag.name;
  return bag.misfit ? `${name}, which was made for another ride` : name;
}
