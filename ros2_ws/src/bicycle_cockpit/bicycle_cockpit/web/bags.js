// A bag instead of the live ride: choose one, play it, scrub through it.

import { Series } from "./series.js";
import { listed, loaded } from "./source.js";

const byId = (id) => document.getElementById(id);
const MARKED = ["reached", "missed", "given_up", "fell", "push", "hand_over", "hand_back"];
const MOST_MARKS = 120;
const NONE = [];
const ENDS = ["reached", "missed", "given_up", "fallen", "cancelled"];

const minutes = (seconds) => `${Math.floor(seconds / 60)}:${String(Math.floor(seconds % 60)).padStart(2, "0")}`;
const element = (name, fields) => Object.assign(document.createElement(name), fields);

/** A bag as the page draws it; `time` is where the cursor is, s from its start. */
export class Bag {
  constructor(data) {
    this.name = data.name;
    this.duration = data.duration;
    this.loop = data.loop;
    this.radius = data.goal_radius;
    this.fallAngle = data.fall_angle;
    this.slots = data.slots ?? [];
    this.geometry = data.geometry ?? null;
    this.series = new Series(data.columns);
    this.series.fill(data.data);
    this.riders = data.riders;
    /** Why the controller does not suit this ride; empty if it does, or if it is a recording. */
    this.misfit = data.misfit ?? "";
    this.events = data.marks;
    this.paths = data.paths ?? [];
    this.arrivals = data.arrivals ?? [];
    this.pedals = this.series.pedal_force.some((force) => Number.isFinite(force) && force !== 0);
    this.time = 0;
  }

  get cursor() {
    return this.series.indexAt(this.time);
  }

  /** What happened up to the cursor. */
  get marks() {
    return this.events.filter(({ t }) => t <= this.time);
  }

  /** The policy that rode at the cursor. */
  get rider() {
    return this.riders[this.series.policy[this.cursor]];
  }

  /** The goal that was ridden to at the cursor: [x, y], and the heading of arrival where one was asked for. */
  get goal() {
    const last = this.marks.findLast(({ kind }) => kind === "active" || ENDS.includes(kind));
    if (last?.kind !== "active") return null;
    const { x, y } = last;
    const heading = this.arrivals.findLast((one) => one.t <= this.time && one.x === x && one.y === y)?.heading;
    return Number.isFinite(heading) ? [x, y, heading] : [x, y];
  }

  /** The path that was followed at the cursor, [x, y] of its points. */
  get path() {
    return this.paths.find((one) => one.from <= this.time && this.time < (one.to ?? Infinity))?.points ?? NONE;
  }

  /** Places that the map must show: where it rode and where it was sent. */
  get places() {
    const goals = this.events.filter(({ kind }) => kind === "active" || ENDS.includes(kind));
    return { xs: [...this.series.x, ...goals.map(({ x }) => x)], ys: [...this.series.y, ...goals.map(({ y }) => y)] };
  }
}

export class BagPlayer {
  /** @param handlers `opened(bag)`, `closed()`, `moved()` */
  constructor(handlers) {
    this.handlers = handlers;
    this.bag = null;
    this.playing = false;
    byId("seek").addEventListener("input", () => this.seek(Number(byId("seek").value)));
    byId("play").addEventListener("click", () => this.toggle());
  }

  /** Shows the list to choose from; `take` gets the name of the chosen one. */
  async choose(take = (name) => this.open(name), title = "Bags", riders = []) {
    this.take = take;
    this.offer(riders);
    byId("bags-title").textContent = title;
    const list = byId("bag-list");
    list.textContent = "reading the folder…";
    byId("bags").showModal();
    try {
      const { bags } = await listed();
      list.textContent = bags.length ? "" : "There is no bag yet: press Record here, or use ride.sh or record.sh.";
      for (const bag of bags) list.append(bag.problem ? this.refusal(bag) : this.entry(bag));
      list.querySelector("button")?.focus();
    } catch (error) {
      list.textContent = error.message;
    }
  }

  /** Controllers that can ride the open bag's goals again. */
  offer(riders) {
    byId("again").hidden = !riders.length;
    byId("again-by").replaceChildren(...riders.map(({ name, label }) => {
      const button = element("button", { type: "button", textContent: label ?? name, title: name });
      button.addEventListener("click", () => this.take(this.bag.name, name, label));
      return button;
    }));
  }

  entry({ name, start, duration, ridden, messages }) {
    const button = element("button", { type: "button" });
    const when = start === null ? "no date" : new Date(1000 * start).toLocaleString();
    const long = ridden === null ? `recorded for ${minutes(duration)} min` : `ride of ${minutes(ridden)} min`;
    const texts = [name, when, long, `${messages} messages`];
    button.append(...texts.map((textContent, index) => element(index ? "small" : "span", { textContent })));
    button.addEventListener("click", () => this.take(name));
    return button;
  }

  /** A bag that cannot be shown, and why. */
  refusal({ name, problem }) {
    const line = element("p", { className: "refusal" });
    line.append(element("span", { textContent: name }), element("small", { textContent: problem }));
    return line;
  }

  /** Reads a ride while the list is shown; null where that fails, and the list says why. */
  async read(name, rider = "", label = rider) {
    byId("bag-list").textContent = rider ? `${label} rides ${name}…` : `reading ${name}…`;
    try {
      const bag = new Bag(await loaded(name, rider));
      byId("bags").close();
      return bag;
    } catch (error) {
      byId("bag-list").textContent = error.message;
      return null;
    }
  }

  async open(name) {
    const bag = await this.read(name);
    if (!bag) return;
    this.bag = bag;
    byId("seek").max = String(bag.duration);
    byId("bag-name").textContent = byId("bag-name").title = name;
    byId("timeline").hidden = false;
    this.mark();
    this.stop();
    this.handlers.opened(bag);
    this.seek(0);
    byId("play").focus();
  }

  /** What happened, on the slider: a click goes there. */
  mark() {
    const { bag } = this;
    const told = bag.events.filter(({ kind }) => MARKED.includes(kind)).slice(0, MOST_MARKS);
    byId("marks").replaceChildren(...told.map(({ t, kind, level, text }) => {
      const button = element("button", { type: "button", title: `${t.toFixed(1)} s: ${text}` });
      button.tabIndex = -1; // with the keyboard the times of the events are there
      button.dataset.kind = kind;
      button.dataset.level = level;
      button.setAttribute("aria-label", button.title);
      button.style.left = `${(100 * t) / (bag.duration || 1)}%`;
      button.addEventListener("click", () => this.seek(t));
      return button;
    }));
  }

  close() {
    if (!this.bag) return;
    this.bag = null;
    this.stop();
    byId("timeline").hidden = true;
    this.handlers.closed();
  }

  seek(time) {
    const { bag } = this;
    if (!bag) return;
    bag.time = Math.min(bag.duration, Math.max(0, time));
    byId("seek").value = String(bag.time);
    byId("seek").setAttribute("aria-valuetext", `${bag.time.toFixed(1)} seconds`);
    byId("seek-shown").textContent = `${bag.time.toFixed(1)} of ${bag.duration.toFixed(1)} s`;
    this.handlers.moved();
  }

  toggle() {
    if (this.playing) return this.stop();
    if (this.bag.time >= this.bag.duration) this.seek(0);
    this.last = performance.now();
    this.plays(true);
    this.handlers.moved();
  }

  stop() {
    this.plays(false);
  }

  plays(on) {
    this.playing = on;
    byId("play").lastChild.textContent = on ? "Stop" : "Play";
  }

  /** Moves on by the time since the last call; called for every picture. */
  advance(now) {
    if (!this.playing || !this.bag) return;
    const elapsed = ((now - this.last) / 1000) * Number(byId("rate").value);
    this.last = now;
    this.seek(this.bag.time + elapsed);
    if (this.bag.time >= this.bag.duration) this.stop();
  }
}
