// The head line and the panels below the charts: loop, training, events.

import { begin, colours } from "./theme.js";
import { labelOf } from "./who.js";

const byId = (id) => document.getElementById(id);
/** A number with so many digits and no minus before zero; a dash for none. */
export function shown(value, digits = 1) {
  if (!Number.isFinite(value)) return "–";
  const text = value.toFixed(digits);
  return Number(text) === 0 ? text.replace("-", "") : text;
}

const percent = (value) => (Number.isFinite(value) ? `${(100 * value).toFixed(value === 1 ? 0 : 1)} %` : "–");

const MODES = {
  riding: "riding", paused: "paused", held: "waits for a goal", fallen: "fallen", silent: "no simulator",
  lost: "connection lost", loading: "loading", zero: "no command", bag: "bag",
};
/** What the state's speed is, where the bicycle does not move. */
const SPEEDS = { held: "starts at", fallen: "fell at", paused: "speed, paused" };
const SOURCES = ["at its start", "fresh", "held", "zero input"];

/** Fills a description list without making its elements anew each time. */
function fill(list, facts) {
  if (list.children.length !== facts.length) {
    list.replaceChildren(...facts.map(([name]) => {
      const item = document.createElement("div");
      item.append(Object.assign(document.createElement("dt"), { textContent: name }), document.createElement("dd"));
      return item;
    }));
  }
  facts.forEach(([, text, level, title], index) => {
    const item = list.children[index];
    const cell = item.lastChild;
    if (cell.textContent !== text) cell.textContent = text;
    item.dataset.level = level ?? "";
    item.title = title ?? "";
  });
}

export function showHead(mode, row) {
  const badge = byId("mode");
  if (badge.dataset.mode !== mode) {
    badge.dataset.mode = mode;
    badge.textContent = MODES[mode] ?? mode;
  }
  byId("speed-name").textContent = SPEEDS[mode] ?? "speed";
  byId("speed").textContent = shown(row?.speed, 2);
  byId("distance").textContent = shown(row?.goal_distance, 1);
  byId("position").textContent = row ? `${shown(row.x)}, ${shown(row.y)}` : "–";
  byId("time").textContent = shown(row?.t, 1);
}

const spread = (loop, name) => `${shown(loop[`${name}_p50`], 2)} / ${shown(loop[`${name}_p99`], 2)} / ${shown(loop[`${name}_max`], 1)}`;

/** @param loop figures @param row present step @param more status of a live ride, or undefined @param off of the estimate @param ride facts */
export function showLoop(loop, row, more, period, off = {}, ride = {}) {
  const panel = byId("loop");
  if (!panel.firstChild) panel.append(Object.assign(document.createElement("dl"), { className: "grid" }));
  const source = row?.source;
  const late = loop.dropped > 0 ? "warn" : "";
  const wanted = period ? 1 / period : NaN;
  // Before the first step there is no rate, and in lock-step none is wanted.
  const slow = Number.isFinite(loop.rate) && loop.rate < 0.98 * wanted && Number.isFinite(loop.lateness_p50);
  const facts = [
    ["rate", `${shown(loop.rate, 2)} Hz`, slow ? "warn" : ""],
    ["jitter, ms: p50 / p99 / max", spread(loop, "jitter"), "", "how far periods are from their median"],
    ["state to command, ms", spread(loop, "latency"), "", "p50 / p99 / max"],
    ["steps late / dropped", `${loop.late ?? 0} / ${loop.dropped ?? 0}`, late, "since the simulator started"],
    ["watchdog", SOURCES[source] ?? "–", source === 3 ? "bad" : source === 2 ? "warn" : source === 1 ? "good" : "",
      more?.commands ?? "where the input of this step came from"],
  ];
  if (more) {
    facts.push(["controllers", String(more.controllers), more.controllers === 1 ? "" : "bad", more.commands]);
    facts.push(["bicycle", ride.plant === "choi" ? `paper's, ${ride.bicycle}` : ride.bicycle ?? "–", "", `${ride.bicycle}, scenario ${ride.scenario}, seed ${ride.seed}`]);
    facts.push(["pages / frames lost", `${more.pages} / ${more.dropped_frames}`, "", "by pages that did not keep up"]);
  }
  if (Number.isFinite(off.lean)) {
    facts.push(["estimate off by", `${shown((off.lean * 180) / Math.PI, 2)}°, ${shown(off.place, 2)} m`, "", "lean and place of the estimate against the truth"]);
  }
  fill(panel.firstChild, facts);
}

export function showTrainer(trainer, history) {
  byId("no-trainer").hidden = Boolean(trainer);
  byId("trainer").hidden = !trainer;
  if (!trainer) return;
  fill(byId("trainer-facts"), [
    ["phase", `${trainer.phase}, ${trainer.mode}`],
    ["updates", `${trainer.updates} (${shown(trainer.update_rate, 0)}/s)`],
    ["transitions", `${trainer.transitions} (${shown(trainer.transition_rate, 0)}/s)`, trainer.lost_transitions ? "warn" : "", `${trainer.lost_transitions} lost`],
    ["goals reached", percent(trainer.reach_rate), "", "of the last candidate's rides"],
    ["falls", percent(trainer.fall_rate), trainer.fall_rate > 0 ? "warn" : ""],
    ["return", shown(trainer.mean_return, 2)],
    ["best: reached, falls", `${percent(trainer.best_reach_rate)}, ${percent(trainer.best_fall_rate)}`],
    ["in charge", trainer.in_charge || "–", "", trainer.in_charge],
    ["last", trainer.message || "–", "", trainer.message],
  ]);
  drawProgress(byId("progress"), history);
}

/** Goal rate, fall rate (0 to 1) and the mean return (its own scale) over updates. */
function drawProgress(canvas, history) {
  if (!canvas.clientWidth) return;
  const { context, width, height } = begin(canvas);
  const [left, right, top, bottom] = [34, width - 60, 8, height - 18];
  const most = Math.max(1, ...history.map((point) => point.updates));
  const returns = history.map((point) => point.mean_return).filter(Number.isFinite);
  const [low, high] = [Math.min(0, ...returns), Math.max(0, ...returns)];
  const x = (updates) => left + (updates / most) * (right - left);
  context.strokeStyle = colours.line;
  context.strokeRect(left, top, right - left, bottom - top);
  context.fillStyle = colours.soft;
  context.fillText("100 %", 0, top + 9);
  context.fillText("0", 20, bottom);
  context.fillText(`${most} updates`, left, height - 4);
  const curves = [
    ["reach_rate", colours.good, "reached", (v) => bottom - v * (bottom - top)],
    ["fall_rate", colours.bad, "falls", (v) => bottom - v * (bottom - top)],
    ["mean_return", colours.accent, "return", (v) => bottom - ((v - low) / (high - low || 1)) * (bottom - top)],
  ];
  curves.forEach(([name, colour, label, y], index) => {
    context.strokeStyle = context.fillStyle = colour;
    context.lineWidth = 1.5;
    context.fillText(label, right + 6, top + 10 + 15 * index);
    context.beginPath();
    for (const point of history) if (Number.isFinite(point[name])) context.lineTo(x(point.updates), y(point[name]));
    context.stroke();
  });
}

const TERMS = [["reward_lean", "lean"], ["reward_rate", "lean rate"], ["reward_acceleration", "lean acceleration"], ["reward_heading", "heading error"]];

/** Equation 20 term by term, its mean over the last ten seconds. */
export function showReward(series, cursor) {
  const box = byId("reward");
  if (byId("training").hidden) return;
  if (!box.firstChild) {
    for (const [, name] of TERMS) {
      box.append(Object.assign(document.createElement("span"), { textContent: `reward: ${name}` }), document.createElement("i"), document.createElement("b"));
    }
  }
  const first = cursor >= 0 ? series.indexAt(series.t[cursor] - 10) : 0;
  const means = TERMS.map(([column]) => {
    const values = series[column].slice(first, cursor + 1).filter(Number.isFinite);
    return values.length ? values.reduce((sum, value) => sum + value, 0) / values.length : NaN;
  });
  const most = Math.max(1e-9, ...means.filter(Number.isFinite).map(Math.abs));
  means.forEach((mean, index) => {
    const [, bar, number] = [...box.children].slice(3 * index, 3 * index + 3);
    bar.style.width = `${Number.isFinite(mean) ? (100 * Math.abs(mean)) / most : 0}%`;
    number.textContent = Number.isFinite(mean) ? mean.toFixed(4) : "–";
  });
}

const MOST_EVENTS = 80;

/** @param event @param seek what a click on its time does, or nothing */
export function addEvent({ t, level, text }, seek = null) {
  const item = document.createElement("li");
  item.dataset.level = level;
  const time = Object.assign(document.createElement("time"), { textContent: `${shown(t, 1)} s` });
  const button = seek && Object.assign(document.createElement("button"), { type: "button", className: "plain" });
  button?.append(time);
  button?.addEventListener("click", () => seek(t));
  item.append(
    button || time,
    Object.assign(document.createElement("span"), { textContent: text }),
  );
  const list = byId("event-list");
  list.prepend(item);
  while (list.children.length > MOST_EVENTS) list.lastChild.remove();
}

export function clearEvents() {
  byId("event-list").replaceChildren();
}

/** The policies whose track is shown, in their colours. */
export function showLegend(riders, colour) {
  const legend = byId("legend");
  const wanted = riders.map((rider) => `${rider.policy} ${labelOf(rider)} ${colour(rider)}`).join("\n");
  if (legend.dataset.shown === wanted) return;
  legend.dataset.shown = wanted;
  legend.hidden = riders.length === 0;
  const twice = (name) => riders.filter((other) => labelOf(other) === name).length > 1;
  legend.replaceChildren(...riders.map((rider) => {
    const item = Object.assign(document.createElement("li"), { title: rider.policy });
    const bar = document.createElement("i");
    bar.style.color = colour(rider);
    item.append(bar, twice(labelOf(rider)) ? rider.policy : labelOf(rider));
    return item;
  }));
}

/** Tabs as the ARIA practices want them: one stop, arrow keys inside. */
export function listenToTabs(changed) {
  const tabs = [...document.querySelectorAll("[role=tab]")];
  const choose = (tab) => {
    for (const other of tabs) {
      const chosen = other === tab;
      other.setAttribute("aria-selected", String(chosen));
      other.tabIndex = chosen ? 0 : -1;
      byId(other.getAttribute("aria-controls")).hidden = !chosen;
    }
    changed();
  };
  tabs.forEach((tab, index) => {
    tab.addEventListener("click", () => choose(tab));
    tab.addEventListener("keydown", (event) => {
      const by = { ArrowRight: 1, ArrowLeft: -1 }[event.key];
      if (!by) return;
      const next = tabs[(index + by + tabs.length) % tabs.length];
      next.focus();
      choose(next);
    });
  });
}
