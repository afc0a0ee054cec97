// The map: grid, track by policy, goals, path ahead, and the bicycle.

import { estimateOf } from "./estimate.js";
import { FONT, begin, colours } from "./theme.js";

const PREVIEW = 3;
const STEP = 0.1;

/**
 * @param {HTMLCanvasElement} canvas
 * @param {View} view
 * @param scene `series`, `paint` (colour of a policy's number), `cursor` (row, -1 for none), `goal`, `ahead`, `marks`,
 *   `radius`, `mark` ([x, y] of the keyboard), `drag` ({from, to}, m), `geometry`, `fallen`, `others` (bicycles of the fleet), `clear` (px under the legend)
 */
export function drawMap(canvas, view, scene) {
  const { context, width, height } = begin(canvas);
  view.sized(width, height);
  const { series, cursor } = scene;
  const row = cursor >= 0 ? series.row(cursor) : null;
  if (row) view.follow(row.x, row.y);
  drawGrid(context, view, scene.clear);
  if (scene.path?.length > 1) {
    context.lineWidth = 6;
    context.globalAlpha = 0.3;
    stroke(context, colours.good, scene.path.map(([x, y]) => view.toScreen(x, y)));
    context.globalAlpha = 1;
  }
  if (cursor < series.length - 1 && scene.whole) drawTrack(context, view, series, 0, series.length - 1, null);
  if (scene.ghost?.cursor >= 0) drawGhost(context, view, scene.ghost, scene.geometry);
  drawTrack(context, view, series, 0, cursor, scene.paint);
  drawEstimate(context, view, series, cursor, scene.geometry);
  for (const other of scene.others ?? []) drawOther(context, view, other, scene.geometry);
  for (const mark of scene.marks) drawMark(context, view, mark, scene.radius);
  drawAhead(context, view, scene, row);
  if (row) {
    if (!scene.fallen) drawPreview(context, view, row, scene.geometry);
    drawBicycle(context, view, row, scene.geometry);
  }
  if (Number.isFinite(scene.pointed?.x)) {
    const [px, py] = view.toScreen(scene.pointed.x, scene.pointed.y);
    circle(context, px, py, 6, colours.accent, 3);
  }
  if (scene.mark) drawCross(context, view, scene.mark);
  if (scene.drag) drawDrag(context, view, scene.drag);
}

function gridStep(view) {
  return [1, 2, 5, 10, 20, 50, 100, 200, 500].find((metres) => metres * view.scale >= 42) ?? 1000;
}

/** @param {number} clear px from the top in which something else stands on the left */
function drawGrid(context, view, clear = 0) {
  const step = gridStep(view);
  const [left, top] = view.toWorld(0, 0);
  const [right, bottom] = view.toWorld(view.width, view.height);
  context.lineWidth = 1;
  context.fillStyle = colours.soft;
  context.font = FONT.replace("12px", "11px");
  for (let x = Math.ceil(left / step) * step; x <= right; x += step) {
    const px = Math.round(view.toScreen(x, 0)[0]) + 0.5;
    stroke(context, x === 0 ? colours.line : colours.grid, [[px, 0], [px, view.height]]);
    if (px > 30 && px + 3 + context.measureText(String(x)).width < view.width - 22) context.fillText(String(x), px + 3, view.height - 5);
  }
  for (let y = Math.ceil(bottom / step) * step; y <= top; y += step) {
    const py = Math.round(view.toScreen(0, y)[1]) + 0.5;
    stroke(context, y === 0 ? colours.line : colours.grid, [[0, py], [view.width, py]]);
    if (py > Math.max(46, clear + 16) && py < view.height - 20) context.fillText(String(y), 5, py - 3);
  }
  context.fillText("m", view.width - 16, view.height - 5);
  context.font = FONT;
}

function stroke(context, colour, points) {
  context.strokeStyle = colour;
  context.beginPath();
  points.forEach(([x, y], index) => (index ? context.lineTo(x, y) : context.moveTo(x, y)));
  context.stroke();
}

/** Rows closer than a pixel to the last one drawn are left out; a reset, or rows that are missing, break the line. */
function drawTrack(context, view, series, from, to, paint, wide = paint ? 2.5 : 1.5) {
  context.lineWidth = wide;
  let colour = null;
  let [lastX, lastY] = [NaN, NaN];
  context.beginPath();
  for (let index = from; index <= to; index++) {
    const [x, y] = view.toScreen(series.x[index], series.y[index]);
    const wanted = paint ? paint(series.policy[index]) : colours.line;
    const broken = index > from && series.broken(index);
    if (wanted !== colour) {
      if (colour) context.stroke();
      context.strokeStyle = colour = wanted;
      context.beginPath();
      if (Number.isFinite(lastX)) context.moveTo(lastX, lastY);
    }
    if (broken || !Number.isFinite(lastX)) context.moveTo(x, y);
    else if (Math.abs(x - lastX) + Math.abs(y - lastY) < 1 && index < to) continue;
    else context.lineTo(x, y);
    [lastX, lastY] = [x, y];
  }
  context.stroke();
}

/** The other ride: its track up to now, and where it is. */
function drawGhost(context, view, ghost, geometry) {
  context.globalAlpha = 0.5;
  drawTrack(context, view, ghost.series, 0, ghost.cursor, () => ghost.colour);
  drawBicycle(context, view, ghost.series.row(ghost.cursor), ghost.bag.geometry ?? geometry);
  context.globalAlpha = 1;
}

/** Where the estimator took the bicycle to be: its track, dashed, and the bicycle there. */
function drawEstimate(context, view, series, cursor, geometry) {
  const estimate = estimateOf(series);
  if (!estimate?.known(cursor)) return;
  let first = cursor;
  while (first > 0 && estimate.known(first - 1)) first--;
  context.setLineDash([5, 4]);
  context.globalAlpha = 0.8;
  drawTrack(context, view, estimate, first, cursor, () => colours.ink, 1.25);
  context.setLineDash([]);
  context.globalAlpha = 0.35;
  drawBicycle(context, view, estimate.row(cursor), geometry);
  context.globalAlpha = 1;
}

/** Another bicycle of the domain, with its name; one that lies is crossed out. */
function drawOther(context, view, other, geometry) {
  if (![other.x, other.y, other.heading].every(Number.isFinite)) return;
  context.globalAlpha = 0.7;
  drawBicycle(context, view, other, geometry);
  context.globalAlpha = 1;
  if (other.fallen) drawMark(context, view, { ...other, kind: "fell" }, 0);
  const [px, py] = view.toScreen(other.x, other.y);
  context.fillStyle = colours.ink;
  context.fillText(other.name, px + 10, py - 10);
}

function drawMark(context, view, { kind, x, y }, radius) {
  const [px, py] = view.toScreen(x, y);
  if (kind === "reached") {
    circle(context, px, py, radius * view.scale, colours.good, 1);
    context.lineWidth = 2;
    stroke(context, colours.good, [[px - 4, py], [px - 1, py + 3], [px + 4, py - 4]]);
  } else if (kind === "fell" || kind === "missed" || kind === "given_up") {
    context.lineWidth = 2;
    const colour = kind === "fell" ? colours.bad : colours.warn;
    stroke(context, colour, [[px - 5, py - 5], [px + 5, py + 5]]);
    stroke(context, colour, [[px - 5, py + 5], [px + 5, py - 5]]);
  } else if (kind === "push") {
    circle(context, px, py, 4, colours.warn, 2);
  } else if (kind === "hand_over") {
    context.lineWidth = 2;
    stroke(context, colours.warn, [[px, py - 6], [px + 6, py], [px, py + 6], [px - 6, py], [px, py - 6]]);
  }
}

function circle(context, x, y, radius, colour, width) {
  context.strokeStyle = colour;
  context.lineWidth = width;
  context.beginPath();
  context.arc(x, y, Math.max(2, radius), 0, 2 * Math.PI);
  context.stroke();
}

/** The goal, those after it with their numbers, and the straight way there. */
function drawAhead(context, view, { goal, ahead, radius }, row) {
  const points = [...(goal ? [goal] : []), ...ahead];
  if (!points.length) return;
  context.setLineDash([6, 5]);
  context.lineWidth = 1.5;
  const way = [...(row ? [[row.x, row.y]] : []), ...points].map(([x, y]) => view.toScreen(x, y));
  stroke(context, colours.good, way);
  context.setLineDash([]);
  context.textAlign = "center";
  points.forEach(([x, y, heading], index) => {
    const [px, py] = view.toScreen(x, y);
    if (Number.isFinite(heading)) drawArrival(context, px, py, heading, Math.max(26, radius * view.scale));
    const active = goal && index === 0;
    context.fillStyle = active ? colours.good : colours.card;
    context.beginPath();
    context.arc(px, py, points.length > 1 ? 9 : 5, 0, 2 * Math.PI);
    context.fill();
    circle(context, px, py, points.length > 1 ? 9 : 5, colours.good, 1.5);
    if (active) circle(context, px, py, Math.max(12, radius * view.scale), colours.good, 1.5);
    if (points.length > 1) {
      context.fillStyle = active ? colours.card : colours.good;
      context.fillText(String(index + 1), px, py + 4);
    }
  });
  context.textAlign = "left";
}

/** An arrow through the goal: the heading that the bicycle is to have there; `reach` is half its length in pixels. */
function drawArrival(context, px, py, heading, reach) {
  context.save();
  context.translate(px, py);
  context.rotate(-heading);
  context.lineWidth = 3;
  context.lineCap = context.lineJoin = "round";
  stroke(context, colours.good, [[-reach, 0], [reach, 0]]);
  stroke(context, colours.good, [[reach - 9, -7], [reach, 0], [reach - 9, 7]]);
  context.restore();
}

/** Where the present steering leads in the next seconds. */
function drawPreview(context, view, row, geometry) {
  if (!geometry) return;
  if (![row.steer, row.speed, row.heading].every(Number.isFinite)) return;
  let { x, y, heading } = row;
  const points = [view.toScreen(x, y)];
  for (let t = 0; t < PREVIEW; t += STEP) {
    heading += ((row.speed * Math.tan(row.steer)) / geometry.wheelbase) * STEP;
    x += row.speed * Math.cos(heading) * STEP;
    y += row.speed * Math.sin(heading) * STEP;
    points.push(view.toScreen(x, y));
  }
  context.lineWidth = 5;
  context.globalAlpha = 0.22;
  stroke(context, colours.ink, points);
  context.globalAlpha = 1;
}

/** To scale where that is large enough to be seen. */
function drawBicycle(context, view, row, geometry) {
  if (!geometry) return;
  const [px, py] = view.toScreen(row.x, row.y);
  const scale = Math.max(view.scale, 15);
  context.save();
  context.translate(px, py);
  context.rotate(-row.heading);
  context.lineWidth = Math.max(3, 0.12 * scale);
  const [front, rearWheel, frontWheel] = [geometry.wheelbase, geometry.rear_radius, geometry.front_radius].map((size) => size * scale);
  stroke(context, colours.tyre, [[-rearWheel, 0], [rearWheel, 0]]);
  stroke(context, colours.frame, [[0, 0], [front - 0.1 * scale, 0]]);
  context.save();
  context.translate(front, 0);
  context.rotate(-(Number.isFinite(row.steer) ? row.steer : 0));
  stroke(context, colours.tyre, [[-frontWheel, 0], [frontWheel, 0]]);
  context.lineWidth = Math.max(2, 0.06 * scale);
  stroke(context, colours.tyre, [[-0.2 * scale, -0.3 * scale], [-0.2 * scale, 0.3 * scale]]);
  context.restore();
  context.fillStyle = colours.rider;
  context.beginPath();
  const side = -(Number.isFinite(row.displacement) ? row.displacement : 0) + 0.6 * Math.sin(row.lean || 0);
  context.ellipse(0.4 * scale, side * scale, 0.16 * scale, 0.24 * scale, 0, 0, 2 * Math.PI);
  context.fill();
  context.restore();
}

function drawCross(context, view, [x, y]) {
  const [px, py] = view.toScreen(x, y);
  context.lineWidth = 1.5;
  for (const [dx, dy] of [[10, 0], [-10, 0], [0, 10], [0, -10]]) {
    stroke(context, colours.accent, [[px + 0.3 * dx, py + 0.3 * dy], [px + dx, py + dy]]);
  }
}

function drawDrag(context, view, { from, to }) {
  const [x, y] = view.toScreen(...from);
  const [tx, ty] = view.toScreen(...to);
  const angle = Math.atan2(ty - y, tx - x);
  context.lineWidth = 2;
  circle(context, x, y, 6, colours.accent, 2);
  stroke(context, colours.accent, [[x, y], [tx, ty]]);
  for (const side of [-0.45, 0.45]) {
    stroke(context, colours.accent, [[tx, ty], [tx - 11 * Math.cos(angle + side), ty - 11 * Math.sin(angle + side)]]);
  }
}
