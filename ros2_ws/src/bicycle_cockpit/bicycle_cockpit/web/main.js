// Puts the page together: what is shown (a live ride or a bag), and what the controls ask for.

import { BagPlayer } from "./bags.js";
import { drawAbove, drawBehind } from "./bike.js";
import { SPAN, drawCharts, spanOf, timeAt } from "./charts.js";
import { answer, offer, showControls, toggle } from "./controls.js";
import { estimateOf, offBy } from "./estimate.js";
import { Film, save } from "./film.js";
import { Fleet } from "./fleet.js";
import { Ghost, gapWords } from "./ghost.js";
import { Guide } from "./guide.js";
import { drawHorizon } from "./horizon.js";
import { listenToKeys } from "./keys.js";
import { Live } from "./live.js";
import { drawMap } from "./map.js";
import { LiveClock, rowAt } from "./motion.js";
import { addEvent, clearEvents, listenToTabs, showHead, showLegend, showLoop, showReward, showTrainer, shown } from "./panels.js";
import { listenTo } from "./pointing.js";
import { listenToStage } from "./scene/pointing.js";
import { Setup } from "./setup.js";
import { Link } from "./socket.js";
import { RIDES, listed } from "./source.js";
import { colours, policyColour, watchTheme } from "./theme.js";
import { View } from "./view.js";
import { Views, asked } from "./views.js";
import { labelOf, showWho, tellBag, tellLive } from "./who.js";

const PICTURE = 1000 / 31;
const FALL = Math.PI / 6;
const byId = (id) => document.getElementById(id);

// Exported for the tests and for the browser's console.
export const live = new Live();
export const view = new View();
const scene = { mark: null, drag: null };
const clock = new LiveClock();
let slots = {};
let ended = "";
let dirty = true;
let stale = true;
const redraw = () => (dirty = stale = true);
export const views = new Views(redraw);
const guide = new Guide(!RIDES && !asked("film"));

// What the cockpit says.

const takers = {
  hello(message) {
    live.hello(message);
    offer((controllers = message.controllers));
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
  palette: (message) => (slots = message.slots),
  event(message) {
    live.event(message);
    if (message.kind === "path" && message.level === "bad") refusal = { ok: false, message: message.text };
    if (message.kind === "process" || (message.kind === "path" && message.level === "bad")) answer({ ok: message.level !== "bad", message: message.text });
    if (message.kind === "end") ended = `${message.text}. Start it again: this page comes back by itself.`;
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
    if (connected) ended = "";
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
    live.quiet = true;
    view.following = false;
    const { xs, ys } = bag.places;
    view.fit(xs, ys);
    for (const { colour: key, slot } of bag.slots) slots = { ...slots, [key]: slot };
    listEvents(bag.events, (time) => player.seek(time));
    showSource();
  },
  closed() {
    live.quiet = false;
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

// A second ride beside the one that is shown.

let ghost = null;
let ghostGap = NaN;
let gapAt = 0;
const GAP_EVERY = 150;

/** Controllers that the cockpit can let ride a bag again: those that come along with it. */
let controllers = [];

async function compare() {
  if (ghost) return beside(null);
  const again = player.bag && !RIDES ? controllers.filter(({ group }) => group !== "trained here") : [];
  await player.choose(async (name, rider) => {
    const bag = await player.read(name, rider);
    if (!bag) return;
    beside(bag);
    if (bag.misfit) answer({ ok: false, message: `${labelOf(bag.riders[0])} does not suit this ride: ${bag.misfit}` });
    if (!player.bag) race(bag);
  }, player.bag ? "A ride to compare with" : "A ride to race against", again);
}

/** m from the origin up to which a ride began there. */
const AT_ORIGIN = 0.05;
const MOST_GOALS = 50;

/** Sends the live bicycle on the ride of its ghost: the same start and the same goals. */
async function race(bag) {
  const { x, y, heading } = bag.series;
  if (![x[0], y[0], heading[0]].every((value) => Math.abs(value) < AT_ORIGIN)) {
    return answer({ ok: true, message: `${bag.name} began elsewhere: send goals, and it rides along from step 0.` });
  }
  const points = bag.events.filter(({ kind }) => kind === "active").map((one) => [one.x, one.y]).slice(0, MOST_GOALS);
  await ask("reset", { random: false });
  if (points.length) await ask("waypoints", { points });
  answer({ ok: true, message: `Race against ${bag.name}: the same start, the same ${points.length} goals.` });
}

function beside(bag) {
  const rider = bag?.riders[0];
  for (const { colour: key, slot } of bag?.slots ?? []) slots = { ...slots, [key]: slot };
  ghost = bag && new Ghost(bag, rider ? colour(rider) : colours.soft, live.facts.time_step ?? 0.025);
  for (const id of ["compare", "race"]) {
    byId(id).setAttribute("aria-pressed", String(Boolean(ghost)));
    byId(id).textContent = ghost ? "No ghost" : id === "compare" ? "Compare…" : "Ghost…";
  }
  redraw();
}

/** Brings the ghost to the moment that is shown. */
function haunt({ series, cursor, marks }, time) {
  if (!ghost || cursor < 0) return null;
  ghost.along(series, cursor, time);
  const now = performance.now();
  if (now - gapAt < GAP_EVERY && !asked("film")) return ghost;
  gapAt = now;
  ghostGap = ghost.gap(series, cursor, time, player.bag ? player.bag.events : marks);
  return ghost;
}

// The charts: the moment under the mouse, and how long a time they show.

let span = SPAN;
let hover = null;
const chartsEnd = () => {
  const { series, cursor } = player.bag ?? live;
  const now = cursor >= 0 ? series.t[cursor] : 0;
  // A bag is known beyond its cursor: a window that is longer than what was ridden shows what comes.
  return player.bag ? Math.min(player.bag.duration, Math.max(now, span)) : now;
};
const charts = byId("charts");
const chartTime = (event) => timeAt(charts, event.clientX - charts.getBoundingClientRect().left, chartsEnd(), span);
charts.addEventListener("pointermove", (event) => point(chartTime(event)));
charts.addEventListener("pointerleave", () => point(null));
charts.addEventListener("click", (event) => {
  const time = chartTime(event);
  if (time !== null && player.bag) player.seek(time);
});
charts.addEventListener("wheel", (event) => {
  event.preventDefault();
  showSpan(span * Math.exp(0.0015 * event.deltaY));
}, { passive: false });
byId("span").addEventListener("change", () => showSpan(Number(byId("span").value)));

function point(time) {
  hover = time;
  redraw();
}

function showSpan(seconds) {
  span = spanOf(seconds);
  const options = [...byId("span").options];
  if (!options.some(({ value }) => Number(value) === Math.round(span))) {
    options.find(({ dataset }) => dataset.own)?.remove();
    const own = new Option(`${Math.round(span)} s`, String(Math.round(span)));
    own.dataset.own = "1";
    byId("span").append(own);
  }
  byId("span").value = String(Math.round(span));
  redraw();
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
  film: () => makeFilm(),
  compare: () => compare(),
  race: () => compare(),
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

const colour = (rider) => policyColour(slots[rider.colour]);

/** All that pictures need of what is shown now. */
function told() {
  const { bag } = player;
  const shownNow = bag ?? live;
  const { series, riders, cursor } = shownNow;
  const row = cursor >= 0 ? series.row(cursor) : null;
  const { facts } = live;
  const fallAngle = (bag ? bag.fallAngle : facts.fall_angle) ?? FALL;
  const paints = riders.map(colour);
  return {
    series, riders, cursor, row, fallAngle, marks: shownNow.marks, paint: (number) => paints[number] ?? colours.soft,
    geometry: bag ? bag.geometry : facts.geometry, goal: bag ? bag.goal : live.status.goal, ahead: bag ? [] : live.status.ahead,
    radius: bag ? bag.radius : facts.goal_radius ?? 1,
    path: bag ? [] : live.path,
    others: bag ? [] : fleet.others,
    pointed: hover === null || cursor < 0 ? null : rowAt(series, hover),
  };
}

function draw() {
  const { bag } = player;
  const moment = told();
  const { series, riders, cursor, row, fallAngle, paint } = moment;
  const { facts } = live;
  const other = haunt(moment, row ? row.t : 0);
  drawMap(byId("map"), view, {
    ...scene, ...moment, ghost: other, wheelbase: moment.geometry?.wheelbase ?? facts.wheelbase ?? 1.11, whole: Boolean(bag),
    fallen: Math.abs(row?.lean) > fallAngle,
  });
  drawBehind(byId("behind"), row ?? undefined, fallAngle);
  drawAbove(byId("above"), row ?? undefined);
  drawCharts(charts, series, chartsEnd(), paint, bag ? bag.pedals : facts.limits?.[2] > 0, { span, now: row ? row.t : 0, hover, ghost: other });
  showGap(other);
  showHead(bag ? "bag" : live.mode, row);
  const who = bag ? tellBag(bag) : tellLive(live, ended);
  showWho(who, colour);
  showAlarm(who);
  showLoop(bag ? bag.loop : live.status.loop, row, bag ? undefined : live.status, facts.time_step, offBy(series, cursor), facts);
  showTrainer(live.trainer, live.training);
  showReward(series, cursor);
  showLegend(series.policiesIn(0, bag ? series.length - 1 : cursor).map((number) => riders[number]).filter(Boolean), colour);
}

/** What the line below the head warns of, large over the picture. */
function showAlarm({ level, text }) {
  const box = byId("alarm");
  box.hidden = !["warn", "bad"].includes(level);
  box.dataset.level = level;
  if (box.textContent !== text) box.textContent = text;
}

/** Who the ghost is, and whether it was made for such a ride. */
function ghostName(bag) {
  const name = labelOf(bag.riders[0]) || bag.name;
  return bag.misfit ? `${name}, which was made for another ride` : name;
}

/** How far the ride is from its ghost. */
function showGap(other) {
  byId("gap").hidden = !other;
  if (!other) return;
  const text = gapWords(ghostGap, ghostName(other.bag));
  if (byId("gap").textContent !== text) byId("gap").textContent = text;
}

/** The bicycle in 3D, between two rows where the moment is. */
function drawStage(now) {
  const moment = told();
  const { series, cursor, paint } = moment;
  const time = player.bag ? player.bag.time : clock.at(cursor >= 0 ? series.t[cursor] : 0, now, Math.min(0.25, (now - lastStage) / 1000));
  const row = cursor >= 0 ? rowAt(series, time) : null;
  const other = haunt(moment, time);
  const beside = other && other.cursor >= 0 ? { series: other.series, cursor: other.cursor, colour: other.colour, geometry: other.bag.geometry, row: rowAt(other.series, other.time) } : null;
  const guess = estimateOf(series);
  const estimate = guess?.known(cursor) ? { series: guess, cursor, colour: colours.ink, geometry: moment.geometry, row: rowAt(guess, time) } : null;
  views.stage.draw({ ...moment, row, jersey: paint(row?.policy), ghost: beside, estimate }, now);
  drawHorizon(byId("horizon"), row ?? undefined, moment.fallAngle);
}

// Films.

/** What a film says of the moment. */
function caption() {
  const { bag } = player;
  const { row, series, cursor, riders, paint } = told();
  const number = cursor >= 0 ? series.policy[cursor] : NaN;
  const { level, text } = bag ? tellBag(bag) : tellLive(live, ended);
  return {
    who: labelOf(riders[number]), colour: paint(number), level,
    facts: row ? `${shown(row.t, 1)} s   ${shown(row.speed, 1)} m/s   lean ${shown((row.lean * 180) / Math.PI, 0)}°` : "",
    alarm: ["warn", "bad"].includes(level) ? text.replace(/ \(.*\)/, "") : "",
    gap: ghost ? gapWords(ghostGap, ghostName(ghost.bag)) : "",
  };
}

const film = new Film(() => ({ stage: byId("stage"), map: byId("map"), main: views.main }), caption);

function makeFilm() {
  if (film.running) return stopFilm();
  if (!Film.type) return answer({ ok: false, message: "This browser makes no films: use report.sh --video on a bag." });
  const box = byId("ride").getBoundingClientRect();
  film.start(Math.round(1.5 * box.width), Math.round(1.5 * box.height), (file, ending) => {
    save(file, `bicycle-${new Date().toISOString().slice(0, 19).replaceAll(":", "-")}.${ending}`);
    answer({ ok: true, message: "The film is among your downloads." });
  });
  byId("film").setAttribute("aria-pressed", "true");
  byId("film").textContent = "Save film";
}

function stopFilm() {
  film.stop();
  byId("film").setAttribute("aria-pressed", "false");
  byId("film").textContent = "Film";
}

let recorded = false;

/** Opens the first ride; in a film the second one comes along. */
async function openRecorded(bags) {
  if (bags.length) await player.open(bags[0].name);
  if (asked("film") && bags.length > 1) beside(await player.read(bags[1].name));
  recorded = true;
}

/** Whether all that a film shows has been read. */
export const complete = () => recorded;

/** One picture of a film of a bag, for `report.sh --video`: a data URL. */
export function frame(time, camera, kind = "image/jpeg") {
  const { stage } = views;
  if (stage.eye.mode !== camera) stage.eye.choose(camera);
  if (camera === "orbit") stage.eye.azimuth = 0.35 * time - 2.3;
  player.seek(time);
  draw();
  drawStage(1000 * time);
  return film.compose(innerWidth, innerHeight).toDataURL(kind, 0.92);
}

let last = 0;
let lastStage = 0;

/** One picture of all that is shown, at once; for measurements. */
export function drawOnce() {
  draw();
  if (views.stage) drawStage(performance.now());
}

function picture(now) {
  requestAnimationFrame(picture);
  if (asked("film")) return;
  player.advance(now);
  const { stage, main } = views;
  if (main === "3d" && stage && (stale || (!player.bag && clock.moving)) && now - lastStage >= stage.pace) {
    stale = false;
    drawStage(now);
    lastStage = now;
  }
  film.take();
  if (!dirty || now - last < PICTURE) return;
  dirty = false;
  last = now;
  draw();
}

watchTheme(() => {
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
