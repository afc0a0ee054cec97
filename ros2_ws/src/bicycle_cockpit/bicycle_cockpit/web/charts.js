// Strip charts of state and command over the last seconds before the cursor.

import { ESTIMATED, estimateOf } from "./estimate.js";
import { shown } from "./panels.js";
import { FONT, begin, colours } from "./theme.js";

/** s that are shown unless chosen otherwise. */
export const SPAN = 20;
const [LEAST_SPAN, MOST_SPAN] = [2, 1800];
const FOOT = 24;
const RIGHT = 10;
const DEGREES = 180 / Math.PI;
const GUTTER = 122;

const STRIPS = [
  { name: "lean", unit: "°", column: "lean", factor: DEGREES, least: 5, digits: 1 },
  { name: "steer", unit: "°", column: "steer", factor: DEGREES, least: 5, digits: 1 },
  { name: "heading error", unit: "°", column: "heading_error", factor: DEGREES, least: 10, digits: 0, most: 180 },
  { name: "torque", unit: "N m", column: "torque", factor: 1, least: 0.2, digits: 2, step: true },
  { name: "displacement", unit: "cm", column: "displacement", factor: 100, least: 2, digits: 1, step: true },
  { name: "pedal force", unit: "N", column: "pedal_force", factor: 1, least: 20, digits: 0, step: true, optional: true },
  { name: "speed", unit: "m/s", column: "speed", factor: 1, least: 0.5, digits: 2, positive: true },
];

/** A bound that does not jump about: 1, 2 or 5 times a power of ten. */
function nice(value) {
  const power = 10 ** Math.floor(Math.log10(value));
  return power * [1, 2, 5, 10].find((factor) => factor * power >= value * 0.999);
}

/** A span within its bounds, s. */
export const spanOf = (seconds) => Math.min(MOST_SPAN, Math.max(LEAST_SPAN, seconds));

/** The time at a place of the charts, s, or null beside them. */
export function timeAt(canvas, px, end, span) {
  const wide = canvas.clientWidth - GUTTER - RIGHT;
  const share = (px - GUTTER) / wide;
  return wide > 0 && share >= 0 && share <= 1 ? end - span + share * span : null;
}

/** The distance of the lines of the time axis, s. */
const stepOf = (span) => [0.5, 1, 2, 5, 10, 15, 30, 60, 120, 300].find((step) => span / step <= 8) ?? 600;

/**
 * @param {HTMLCanvasElement} canvas
 * @param {Series} series
 * @param {number} end s, at the right edge
 * @param {(policy: number) => string} paint the colour of a policy by its number
 * @param {boolean} pedals whether the bicycle can be pedalled: then its force has a strip
 * @param more `span` (s), `now` (s, where the ride is), `hover` (s or null), `ghost` (null, or a Ghost)
 */
export function drawCharts(canvas, series, end, paint, pedals, { span = SPAN, now = end, hover = null, ghost = null } = {}) {
  const { context, width, height } = begin(canvas);
  const strips = STRIPS.filter(({ optional }) => pedals || !optional);
  const each = (height - FOOT) / strips.length;
  const label = `Strip charts of ${Math.round(span)} seconds: ${strips.map(({ name }) => name).join(", ")}`;
  if (canvas.getAttribute("aria-label") !== label) canvas.setAttribute("aria-label", label);
  const last = series.length ? series.indexAt(end) : -1;
  const first = series.length ? series.indexAt(end - span) : 0;
  const area = { left: GUTTER, right: width - RIGHT, start: end - span, end, span };
  const x = (t) => area.left + ((t - area.start) / span) * (area.right - area.left);
  axis(context, area, x, height);
  const shownAt = series.length ? series.indexAt(hover ?? now) : -1;
  strips.forEach((strip, index) => {
    const box = { top: index * each, bottom: (index + 1) * each };
    if (index) rule(context, 0, width, box.top, colours.line);
    drawStrip(context, strip, box, series, first, last, x, area, paint, shownAt, ghost);
  });
  if (now < end - 1e-6) cursor(context, x(now), height, colours.soft);
  if (hover === null) return;
  cursor(context, x(hover), height, colours.accent);
  context.fillStyle = colours.accent;
  context.textAlign = x(hover) > area.right - 60 ? "right" : "left";
  context.font = `600 ${FONT}`;
  context.fillText(`${shown(hover, 2)} s`, x(hover) + (context.textAlign === "right" ? -5 : 5), height - FOOT - 5);
  context.textAlign = "left";
}

function cursor(context, at, height, colour) {
  context.strokeStyle = colour;
  context.lineWidth = 1.5;
  context.beginPath();
  context.moveTo(at, 0);
  context.lineTo(at, height - FOOT);
  context.stroke();
}

function rule(context, from, to, y, colour) {
  context.strokeStyle = colour;
  context.lineWidth = 1;
  context.beginPath();
  context.moveTo(from, Math.round(y) + 0.5);
  context.lineTo(to, Math.round(y) + 0.5);
  context.stroke();
}

function axis(context, area, x, height) {
  const step = stepOf(area.span);
  context.strokeStyle = colours.grid;
  context.lineWidth = 1;
  context.fillStyle = colours.soft;
  context.textAlign = "center";
  for (let t = Math.ceil(area.start / step) * step; t <= area.end; t += step) {
    const at = Math.round(x(t)) + 0.5;
    context.beginPath();
    context.moveTo(at, 0);
    context.lineTo(at, height - FOOT);
    context.stroke();
    if (t >= 0 && at > area.left + 8 && at < area.right - 14) context.fillText(`${t} s`, at, height - 8);
  }
  context.textAlign = "left";
}

function drawStrip(context, strip, box, series, first, last, x, area, paint, shownAt, ghost) {
  const values = series[strip.column];
  let most = strip.least;
  for (const column of [values, series[ESTIMATED[strip.column]]]) {
    for (let index = first; column && index <= last; index++) {
      const value = Math.abs(column[index] * strip.factor);
      if (value > most) most = value;
    }
  }
  most = Math.min(nice(most), strip.most ?? Infinity);
  const least = strip.positive ? 0 : -most;
  const pad = 7;
  const y = (value) => box.bottom - pad - ((value - least) / (most - least)) * (box.bottom - box.top - 2 * pad);
  if (!strip.positive) rule(context, area.left, area.right, y(0), colours.grid);

  const low = box.bottom - box.top < 42;
  const font = low ? FONT.replace("12px", "11px") : FONT;
  const [upper, lower] = low ? [box.top + 13, box.top + 26] : [box.top + 17, box.top + 33];
  context.font = font;
  context.fillStyle = colours.soft;
  context.fillText(strip.name, 10, upper);
  const now = shownAt >= 0 ? values[shownAt] * strip.factor : NaN;
  context.fillStyle = colours.ink;
  context.font = `600 ${font}`;
  context.fillText(Number.isFinite(now) ? `${shown(now, strip.digits)} ${strip.unit}` : "–", 10, lower);
  context.font = font;
  context.textAlign = "right";
  context.fillStyle = colours.soft;
  context.fillText(`${strip.positive ? "0…" : "±"}${most}`, area.left - 8, lower);
  context.font = FONT;
  context.textAlign = "left";
  if (last < 0) return;

  context.save();
  context.beginPath();
  context.rect(area.left, box.top, area.right - area.left, box.bottom - box.top);
  context.clip();
  if (ghost) {
    const other = ghost.series;
    context.lineWidth = 1;
    context.globalAlpha = 0.55;
    trace(context, strip, other, other.indexAt(area.start - ghost.shift), other.indexAt(area.end - ghost.shift), (t) => x(t + ghost.shift), y, () => ghost.colour);
    context.globalAlpha = 1;
  }
  context.lineWidth = 1.5;
  trace(context, strip, series, first, last, x, y, paint);
  drawEstimate(context, strip, series, area, x, y, box);
  context.restore();
}

/** What the estimator said, dashed. */
function drawEstimate(context, strip, series, area, x, y, box) {
  const estimate = ESTIMATED[strip.column] ? estimateOf(series) : null;
  if (!estimate || !estimate.length) return;
  const [first, last] = [estimate.indexAt(area.start), estimate.indexAt(area.end)];
  context.lineWidth = 1.25;
  context.setLineDash([5, 4]);
  trace(context, strip, estimate, first, last, x, y, () => colours.ink);
  context.setLineDash([]);
  if (strip.column !== "lean" || !estimate.within(first, last)) return;
  context.fillStyle = colours.ink;
  context.textAlign = "right";
  context.fillText("dashed: estimate", area.right - 4, box.bottom - 5);
  context.textAlign = "left";
}

/** The line, in the colour of the policy that rode; gaps where nothing is known. */
function trace(context, strip, series, first, last, x, y, paint) {
  const times = series.t;
  const values = series[strip.column];
  let colour = null;
  let pen = false;
  let before = 0;
  for (let index = first; index <= last; index++) {
    const wanted = paint(series.policy[index]);
    const value = values[index] * strip.factor;
    const jump = index > first && series.broken(index);
    if (wanted !== colour) {
      if (colour) context.stroke();
      context.strokeStyle = colour = wanted;
      context.beginPath();
      if (pen) context.moveTo(x(times[index - 1]), y(before));
    }
    if (!Number.isFinite(value)) pen = false;
    else {
      if (!pen || jump) context.moveTo(x(times[index]), y(value));
      else {
        if (strip.step) context.lineTo(x(times[index]), y(before));
        context.lineTo(x(times[index]), y(value));
      }
      pen = true;
      before = value;
    }
  }
  context.stroke();
}
