// What the cockpit tells of the ride that goes on.

import { addEvent, clearEvents } from "./panels.js";
import { Series } from "./series.js";

const MARKED = ["reached", "missed", "given_up", "fell", "push", "hand_over"];
const MOST_MARKS = 300;
const MOST_EVENTS = 200;
const NOBODY = { policy: "", name: "", colour: "" };

export class Live {
  constructor() {
    this.series = new Series(["t"]);
    this.earlier = null;
    this.riders = [];
    this.marks = [];
    this.path = [];
    this.events = [];
    this.facts = {};
    this.status = { mode: "silent", paused: false, loop: {}, ahead: [], goal: null, recording: null, trouble: "", misfit: "",
      who: { driver: NOBODY, chosen: NOBODY } };
    this.trainer = null;
    this.training = [];
    this.connected = this.greeted = false;
    this.quiet = false;
    this.session = "";
    this.ride = -1;
    this.told = -1;
  }

  get cursor() {
    return this.series.length - 1;
  }

  /** `lost`, `loading`, or the simulator's own word: riding, paused, held, fallen, silent, and `zero` without a command. */
  get mode() {
    if (!this.connected) return this.session ? "lost" : "loading";
    const { mode } = this.status;
    if (!this.greeted || (mode !== "silent" && this.series.length === 0)) return "loading";
    const withoutCommand = this.series.source?.[this.cursor] === 3;
    return mode === "riding" && withoutCommand ? "zero" : mode;
  }

  /** Begins anew; who comes back to the same cockpit keeps what it has, see `history`. */
  hello(message) {
    const same = message.session === this.session;
    const goesOn = same && message.ride === this.ride && this.series.length > 0;
    this.earlier = goesOn ? this.series : null;
    this.series = new Series(message.columns, message.next);
    if (!goesOn) this.marks = [];
    if (!same) {
      this.told = -1;
      this.events = [];
      this.path = [];
      this.riders = [];
      if (!this.quiet) clearEvents();
    }
    this.session = message.session;
    this.ride = message.ride;
    this.facts = { ...this.facts, ...message.facts };
    this.training = message.training;
    for (const event of message.events) this.event(event);
  }

  /** Rows from before, the newest piece first; what was there before the connection was lost follows them. */
  history({ ride, first, rows }) {
    if (ride !== this.ride || !rows.length) return;
    const { earlier } = this;
    const known = earlier ? Math.max(0, Math.min(rows.length, earlier.next - first)) : 0;
    if (known < rows.length && !this.series.prepend(rows.slice(known), first + known)) return;
    if (known && earlier.next === this.series.first) {
      this.series.put(earlier.data, earlier.first);
      this.earlier = null;
    }
  }

  frame({ ride, first, rows }) {
    if (ride !== this.ride) {
      // The simulator was started anew: what was is gone.
      this.ride = ride;
      this.series = new Series(this.series.columns, first);
      this.earlier = null;
      this.marks = [];
    }
    this.series.push(rows, first);
  }

  event(event) {
    if (event.n <= this.told) return;
    this.told = event.n;
    if (event.ride === this.ride && MARKED.includes(event.kind) && Number.isFinite(event.x)) this.marks.push(event);
    if (this.marks.length > MOST_MARKS) this.marks.shift();
    this.events.push(event);
    if (this.events.length > MOST_EVENTS) this.events.shift();
    if (!this.quiet) addEvent(event);
  }

  trained(message) {
    this.trainer = message;
    if (message.updates !== this.training.at(-1)?.updates) this.training.push(message);
  }
}
