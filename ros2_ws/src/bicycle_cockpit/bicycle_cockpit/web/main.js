// Puts the page together: what is shown (a live ride or a bag), and what the controls ask for.

import { BagPlayer } from "./bags.js";
import { ChartWindow } from "./chart_window.js";
import { Comparison } from "./comparison.js";
import { answer, offer, showControls, toggle } from "./controls.js";
import { Filming } from "./filming.js";
import { Fleet } from "./fleet.js";
import { Guide } from "./guide.js";
import { listenToKeys } from "./keys.js";
import { Live } from "./live.js";
import { addToPalette, usePalette } from "./palette.js";
import { addEvent, clearEvents, listenToTabs } from "./panels.js";
import { Pictures } from "./pictures.js";
import { listenTo } from "./pointing.js";
import { listenToStage } from "./scene/pointing.js";
import { Setup } from "./setup.js";
import { Link } from "./socket.js";
import { RIDES, listed } from "./source.js";
import { watchTheme } from "./theme.js";
import { View } from "./view.js";
import { Views, asked } from "./views.js";

const PICTURE = 1000 / 31;
const byId = (id) => document.getElementById(id);

// Exported for the tests and for the browser's console.
export const live = new Live();
export const view = new View();
let dirty = true;
let stale = true;
const redraw = () => (dirty = stale = true);
export const views = new Views(redraw);
const guide = new Guide(!RIDES && !asked("film"));

// What the cockpit says.

const takers = {
  hello(message) {
    live.hello(message);
    offer((comparison.controllers = message.controllers));
    setup.offer(message);
    showStatus();
  },
  history: (message) => live.history(message),
  facts: (message) => (live.facts = message),
  frame: (message) => live.frame(message),
  riders: (message) => (live.riders = message.riders),
  path: (message) => (live.path = message.points),
  fleet: (message) => fleet.take(message),
  setup: ({ type, ...values }) => (setup.values = values),
  palette: (message) => usePalette(message.slots),
  event(message) {
    live.event(message);
    if (message.kind === "path" && message.level === "bad") refusal = { ok: false, message: message.text };
    if (message.kind === "process" || (message.kind === "path" && message.level === "bad")) answer({ ok: message.level !== "bad", message: message.text });
    if (message.kind === "end") pictures.ended = `${message.text}. Start it again: this page comes back by itself.`;
  },
  status(message) {
    live.status = message;
    live.greeted = true;
    showStatus();
  },
  trainer: (message) => live.trained(message),
  answer: (message) => answer(message),
};

// A page without a cockpit shows recorded rides only.
export const link = RIDES ? null : new Link(
  (message) => {
    takers[message.type]?.(message);
    redraw();
  },
  (connected) => {
    if (connected) pictures.ended = "";
    if (connected && live.session) answer({ ok: true, message: "connected again" });
    live.connected = connected;
    live.greeted = false;
    showStatus();
    redraw();
  },
);

export const player = new BagPlayer({
  opened(bag) {
    guide.done("bag");
    guide.aside(true);
    live.quiet = true;
    view.following = false;
    const { xs, ys } = bag.places;
    view.fit(xs, ys);
    addToPalette(bag.slots);
    listEvents(bag.events, (time) => player.seek(time));
    showSource();
  },
  closed() {
    live.quiet = false;
    guide.aside(false);
    view.following = true;
    listEvents(live.events);
    showSource();
  },
  moved: redraw,
});

function listEvents(events, seek = null) {
  clearEvents();
  for (const event of events) addEvent(event, seek);
}

// What the user asks for.

const TRIED = { goal: "goal", waypoints: "goal", course: "goal", setup: "switch", push: "push", controller: "switch" };

/** Why the path that was asked for last is not ridden; the controller may say so before the answer comes. */
let refusal;

async function ask(type, fields) {
  if (TRIED[type]) guide.done(TRIED[type]);
  if (type === "course") refusal = undefined;
  const told = link ? await link.ask(type, fields) : { ok: false, message: "This page shows recorded rides: the cockpit rides live." };
  answer((type === "course" && refusal) || told);
}

const setup = new Setup(ask, () => live.status.who.chosen.name);
export const fleet = new Fleet((name) => ask("bicycle", { name }));
const comparison = new Comparison(player, live, ask, redraw);
const chart = new ChartWindow(byId("charts"), byId("span"), () => player.bag ?? live, { seek: (time) => player.seek(time), changed: redraw });
const pictures = new Pictures({ live, player, fleet, view, views, chart, comparison });
const filming = new Filming(pictures);

/** A control that acts on the live ride; in a bag it does nothing. */
const acts = (type, fields = () => ({})) => () => player.bag || ask(type, fields());

const strength = () => Number(byId("strength").value);
const actions = {
  pause: acts("pause", () => ({ paused: !live.status.paused })),
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
  swap: () => views.swap(),
  camera: () => nextCamera(),
  film: () => filming.toggle(),
  compare: () => comparison.choose(),
  race: () => comparison.choose(),
  live: () => player.close(),
  bag: () => player.choose(),
  "set-up": () => player.bag || setup.open(),
  help: () => byId("keys").showModal(),
};
for (const [id, action] of Object.entries(actions)) byId(id)?.addEventListener("click", action);

function nextCamera() {
  const buttons = [...document.querySelectorAll("[data-camera]")];
  const at = buttons.findIndex((button) => button.getAttribute("aria-pressed") === "true");
  views.look(buttons[(at + 1) % buttons.length].dataset.camera);
}

function follow(on) {
  view.following = on;
  byId("follow").setAttribute("aria-pressed", String(on));
  redraw();
}

function zoom(factor) {
  if (views.main === "3d") views.stage.eye.zoom(factor);
  else view.zoom(factor);
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
    pictures.drag = player.bag ? null : drag;
    redraw();
  },
  moved(away = true) {
    if (away) follow(false);
    redraw();
  },
  mark(mark) {
    pictures.mark = mark;
    if (mark) byId("mark").textContent = `mark at ${mark[0]}, ${mark[1]} metres`;
    redraw();
  },
});

listenToStage(byId("stage"), () => views.stage, {
  goal: (x, y) => player.bag || ask("goal", { x, y }),
  waypoint: (x, y) => player.bag || ask("waypoints", { points: [[x, y]] }),
  adding: () => byId("waypoints").getAttribute("aria-pressed") === "true",
  push: (rate) => ask("push", { lean_rate: rate }),
  pushable: () => !player.bag && !byId("push-left").disabled,
  pulled: showPull,
  moved(turned) {
    if (turned) views.showCamera();
    redraw();
  },
});

/** The arrow of a push that is being drawn by hand. */
function showPull(pull) {
  const bar = byId("pull");
  bar.hidden = !pull;
  if (!pull) return;
  const [dx, dy] = [pull.to[0] - pull.from[0], pull.to[1] - pull.from[1]];
  Object.assign(bar.style, { left: `${pull.from[0]}px`, top: `${pull.from[1]}px`, width: `${Math.hypot(dx, dy)}px`, rotate: `${Math.atan2(dy, dx)}rad` });
  const side = pull.rate > 0 ? "right" : "left";
  answer({ ok: true, message: pull.rate ? `Let go: a push of ${Math.abs(pull.rate).toFixed(2)} rad/s to the ${side}` : "Drag farther to push" });
}

listenToTabs(redraw);
listenToKeys(actions, () => (player.bag ? player.toggle() : actions.pause()), byId("letters"));

// What is shown.

function showSource() {
  const { bag } = player;
  byId("live").setAttribute("aria-pressed", String(!bag));
  byId("bag").setAttribute("aria-pressed", String(Boolean(bag)));
  byId("follow").setAttribute("aria-pressed", String(view.following));
  const back = RIDES ? "" : " Live brings the ride back.";
  answer({ ok: true, message: bag ? `${bag.name}: drag the slider below, or press Play.${back}` : "" });
  showStatus();
  redraw();
}

function showStatus() {
  const { bag } = player;
  // What is old must not look as if it were going on.
  document.body.classList.toggle("stale", !bag && ["lost", "silent"].includes(live.mode));
  showControls(live.status, Boolean(bag) || live.mode === "lost");
}

// What a film of a bag shows, see `report.sh --video`.

let recorded = false;

/** Opens the first ride; in a film the second one comes along. */
async function openRecorded(bags) {
  if (bags.length) await player.open(bags[0].name);
  if (asked("film") && bags.length > 1) comparison.beside(await player.read(bags[1].name));
  recorded = true;
}

/** Whether all that a film shows has been read. */
export const complete = () => recorded;

/** One picture of a film of a bag: a data URL. */
export const frame = (time, camera, kind = "image/jpeg") => filming.frame(time, camera, kind);

// Time and again.

let last = 0;

/** What a picture consists of, drawn at once; for measurements. */
export const parts = { flat: () => pictures.draw(), stage: () => pictures.drawStage(performance.now()) };

function picture(now) {
  requestAnimationFrame(picture);
  if (asked("film")) return;
  followTheme();
  player.advance(now);
  const { stage, main } = views;
  if (main === "3d" && stage && (stale || (!player.bag && pictures.clock.moving)) && now - pictures.lastStage >= stage.pace && stage.ready(now)) {
    stale = false;
    pictures.drawStage(now);
  }
  filming.take();
  if (!dirty || now - last < PICTURE) return;
  dirty = false;
  last = now;
  pictures.draw();
}

const followTheme = watchTheme(() => {
  views.stage?.themed();
  redraw();
});
addEventListener("resize", redraw);
if (asked("film")) {
  document.body.classList.add("film");
  views.choose("3d", false);
}
if (RIDES) {
  document.body.classList.add("recorded");
  listed().then(({ bags }) => openRecorded(bags), (error) => answer({ ok: false, message: error.message }));
}
if (!asked("film")) views.start();
requestAnimationFrame(picture);
