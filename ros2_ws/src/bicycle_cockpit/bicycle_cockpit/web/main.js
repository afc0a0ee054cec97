// Puts the page together: what is shown (a live ride or a bag), and what the controls ask for.

import { BagPlayer } from "./bags.js";
import { drawAbove, drawBehind } from "./bike.js";
import { drawCharts } from "./charts.js";
import { listenToKeys } from "./keys.js";
import { Live } from "./live.js";
import { drawMap } from "./map.js";
import { addEvent, clearEvents, listenToTabs, showHead, showLegend, showLoop, showReward, showTrainer, shown } from "./panels.js";
import { listenTo } from "./pointing.js";
import { Link } from "./socket.js";
import { watchTheme } from "./theme.js";
import { View } from "./view.js";

const PICTURE = 1000 / 31;
const byId = (id) => document.getElementById(id);

const live = new Live();
const view = new View();
const scene = { mark: null, drag: null };
let dirty = true;
const redraw = () => (dirty = true);

// What the cockpit says.

const takers = {
  hello(message) {
    live.hello(message);
    offer(message.controllers);
  },
  facts: (message) => (live.facts = message),
  frame: (message) => live.frame(message),
  event: (message) => live.event(message),
  status(message) {
    live.status = message;
    if (message.policy) live.policies.add(live.series.t?.[0] ?? 0, message.policy);
    showStatus();
  },
  trainer: (message) => live.trained(message),
  answer: (message) => answer(message),
};

const link = new Link(
  (message) => {
    takers[message.type]?.(message);
    redraw();
  },
  (connected) => {
    live.connected = connected;
    showStatus();
    redraw();
  },
);

const player = new BagPlayer({
  opened(bag) {
    live.quiet = true;
    view.following = false;
    view.fit(bag.series.x, bag.series.y);
    clearEvents();
    for (const mark of bag.events) addEvent({ ...mark, level: { reached: "good", fell: "bad", missed: "warn" }[mark.kind] ?? "info" });
    showSource();
  },
  closed() {
    live.quiet = false;
    view.following = true;
    clearEvents();
    showSource();
  },
  moved: redraw,
});

// What the user asks for.

function answer({ ok, message }) {
  byId("answer").textContent = message;
  byId("answer").dataset.ok = String(ok);
}

async function ask(type, fields) {
  answer(await link.ask(type, fields));
}

/** A control that acts on the live ride; in a bag it does nothing. */
const acts = (type, fields = () => ({})) => () => player.bag || ask(type, fields());

const strength = () => Number(byId("strength").value);
const actions = {
  pause: acts("pause", () => ({ paused: live.status.mode !== "paused" })),
  step: acts("step"),
  reset: acts("reset", () => ({ random: false })),
  random: acts("reset", () => ({ random: true })),
  clear: acts("clear"),
  record: acts("record", () => ({ on: !live.status.recording })),
  "push-left": acts("push", () => ({ lean_rate: -strength() })),
  "push-right": acts("push", () => ({ lean_rate: strength() })),
  waypoints: () => toggle(byId("waypoints")),
  follow: () => follow(!view.following),
  "zoom-in": () => zoom(1.35),
  "zoom-out": () => zoom(1 / 1.35),
  live: () => player.close(),
  bag: () => player.choose(),
  help: () => byId("keys").showModal(),
};
for (const [id, action] of Object.entries(actions)) byId(id).addEventListener("click", action);

function toggle(button) {
  button.setAttribute("aria-pressed", String(button.getAttribute("aria-pressed") !== "true"));
}

function follow(on) {
  view.following = on;
  byId("follow").setAttribute("aria-pressed", String(on));
  redraw();
}

function zoom(factor) {
  view.zoom(factor);
  redraw();
}

byId("strength").addEventListener("input", () => (byId("strength-shown").textContent = `${strength().toFixed(2)} rad/s`));
byId("controller").addEventListener("change", (event) => ask("controller", { name: event.target.value }));

listenTo(byId("map"), view, {
  goal: (x, y, heading) => player.bag || ask("goal", heading === null ? { x, y } : { x, y, heading }),
  waypoint: (x, y) => player.bag || ask("waypoints", { points: [[x, y]] }),
  adding: () => byId("waypoints").getAttribute("aria-pressed") === "true",
  start: () => [Math.round(live.series.x?.[live.cursor] ?? 0), Math.round(live.series.y?.[live.cursor] ?? 0)],
  dragged(drag) {
    scene.drag = player.bag ? null : drag;
    redraw();
  },
  moved(away = true) {
    if (away) follow(false);
    redraw();
  },
  mark(mark) {
    scene.mark = mark;
    if (mark) byId("mark").textContent = `mark at ${mark[0]}, ${mark[1]} metres`;
    redraw();
  },
});

listenToTabs(redraw);
listenToKeys(actions, () => (player.bag ? player.toggle() : actions.pause()));

/** The controllers to choose from, in their groups. */
function offer(controllers) {
  const groups = Map.groupBy ? Map.groupBy(controllers, ({ group }) => group) : grouped(controllers);
  const unknown = Object.assign(new Option("–", ""), { hidden: true });
  byId("controller").replaceChildren(unknown, ...[...groups].map(([label, members]) => {
    const group = Object.assign(document.createElement("optgroup"), { label });
    group.append(...members.map(({ name }) => new Option(name, name)));
    return group;
  }));
  showStatus();
}

function grouped(controllers) {
  const groups = new Map();
  for (const one of controllers) groups.set(one.group, [...(groups.get(one.group) ?? []), one]);
  return groups;
}

// What is shown.

function showSource() {
  const { bag } = player;
  byId("live").setAttribute("aria-pressed", String(!bag));
  byId("bag").setAttribute("aria-pressed", String(Boolean(bag)));
  byId("follow").setAttribute("aria-pressed", String(view.following));
  for (const control of document.querySelectorAll(".controls button, .controls select, .controls input")) control.disabled = Boolean(bag);
  byId("answer").textContent = bag ? `${bag.name}: drag the slider below, or press Play. Live brings the ride back.` : "";
  redraw();
}

function showStatus() {
  const { status } = live;
  const paused = status.mode === "paused";
  byId("pause").setAttribute("aria-pressed", String(paused));
  byId("pause").lastChild.textContent = paused ? "Go on" : "Pause";
  byId("record").setAttribute("aria-pressed", String(Boolean(status.recording)));
  byId("record").lastChild.textContent = status.recording ? "Stop recording" : "Record";
  const select = byId("controller");
  const names = [...select.options].map(({ value }) => value);
  select.options[0] && (select.options[0].textContent = status.policy || "–");
  if (document.activeElement !== select) select.value = names.includes(status.controller) ? status.controller : "";
}

function draw() {
  const { bag } = player;
  const shownNow = bag ?? live;
  const { series, policies, cursor } = shownNow;
  const row = cursor >= 0 ? series.row(cursor) : null;
  const { facts } = live;
  const wheelbase = facts.wheelbase ?? 1.11;
  drawMap(byId("map"), view, {
    ...scene, series, policies, cursor, wheelbase, whole: Boolean(bag), marks: shownNow.marks,
    goal: bag ? bag.goal : live.status.goal, ahead: bag ? [] : live.status.ahead,
    radius: bag ? bag.radius : facts.goal_radius ?? 1,
  });
  drawBehind(byId("behind"), row ?? undefined, facts.fall_angle ?? Math.PI / 6);
  drawAbove(byId("above"), row ?? undefined);
  drawCharts(byId("charts"), series, row ? row.t : 0, policies);
  showHead(bag ? "bag" : live.mode, row, bag ? policies.at(bag.time) : live.status.policy);
  showLoop(bag ? bag.loop : live.status.loop, row, bag ? undefined : live.status, facts.time_step);
  showTrainer(live.trainer, live.training);
  showReward(series, cursor);
  showLegend(policies);
}

let last = 0;
function picture(now) {
  requestAnimationFrame(picture);
  if (now - last < PICTURE) return;
  player.advance(now);
  if (!dirty) return;
  dirty = false;
  last = now;
  draw();
}

watchTheme(redraw);
addEventListener("resize", redraw);
requestAnimationFrame(picture);
