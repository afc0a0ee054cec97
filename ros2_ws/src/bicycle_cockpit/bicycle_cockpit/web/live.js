// What the cockpit tells of the ride that goes on.

import { addEvent, clearEvents } from "./panels.js";
import { Policies, Series } from "./series.js";

const MARKED = ["reached", "missed", "given_up", "fell", "push"];
const MOST_MARKS = 300;

export class Live {
  constructor() {
    this.series = new Series(["t"]);
    this.policies = new Policies();
    this.marks = [];
    this.facts = {};
    this.status = { mode: "silent", loop: {}, ahead: [], goal: null };
    this.trainer = null;
    this.training = [];
    this.connected = false;
    this.quiet = false;
  }

  get cursor() {
    return this.series.length - 1;
  }

  get mode() {
    if (!this.connected) return "lost";
    const { mode } = this.status;
    const starved = this.series.source?.[this.cursor] === 3;
    return mode === "riding" && starved ? "zero" : mode;
  }

  hello(message) {
    this.series = new Series(message.columns);
    this.series.push(message.rows);
    this.facts = { ...this.facts, ...message.facts };
    this.policies = new Policies();
    this.marks = [];
    this.training = message.training;
    if (!this.quiet) clearEvents();
    for (const event of message.events) this.event(event);
    if (this.status.policy) this.policies.add(this.series.t[0] ?? 0, this.status.policy);
  }

  frame({ rows }) {
    if (this.series.length && rows.length && rows[0][0] < this.series.t[this.cursor]) {
      this.policies = new Policies([{ t: rows[0][0], name: this.status.policy }]);
      this.marks = [];
    }
    this.series.push(rows);
  }

  event(event) {
    if (event.kind === "policy") this.policies.add(event.t, event.name);
    if (MARKED.includes(event.kind)) {
      const index = this.series.length ? this.series.indexAt(event.t) : -1;
      const [x, y] = [event.x ?? this.series.x?.[index], event.y ?? this.series.y?.[index]];
      if (Number.isFinite(x)) this.marks.push({ ...event, x, y });
      if (this.marks.length > MOST_MARKS) this.marks.shift();
    }
    if (!this.quiet) addEvent(event);
  }

  trained(message) {
    this.trainer = message;
    if (message.updates !== this.training.at(-1)?.updates) this.training.push(message);
  }
}
