// The bicycle from behind and from above, to scale. Lean is positive to the right, steering and
// the rider's displacement to the left, as in the messages.

import { begin, colours } from "./theme.js";

const NARROW = 240;
/** m from the ground to the scale of the lean, well above the rider's head. */
const DIAL = 2.0;
const degrees = (angle) => (angle * 180) / Math.PI;

/** A number with its side: "3.2° right". */
function sided(value, unit, digits, positive, negative) {
  const shown = Math.abs(value).toFixed(digits);
  if (!Number.isFinite(value)) return "–";
  return `${shown}${unit}${Number(shown) === 0 ? "" : ` ${value > 0 ? positive : negative}`}`;
}

/** Names and values along the foot, one above the other where it is narrow. */
function labels(context, width, height, pairs) {
  const narrow = width < NARROW;
  pairs.forEach(([name, value], index) => {
    const long = context.measureText(`${name} `).width;
    const x = narrow || index === 0 ? 10 : width - 12 - long - context.measureText(value).width;
    const y = height - 10 - (narrow ? 15 * (pairs.length - 1 - index) : 0);
    context.fillStyle = colours.soft;
    context.fillText(name, x, y);
    context.fillStyle = colours.ink;
    context.fillText(value, x + long, y);
  });
}

function line(context, colour, width, ...points) {
  context.strokeStyle = colour;
  context.lineWidth = width;
  context.beginPath();
  points.forEach(([x, y], index) => (index ? context.lineTo(x, y) : context.moveTo(x, y)));
  context.stroke();
}

function ellipse(context, colour, x, y, rx, ry) {
  context.fillStyle = colour;
  context.beginPath();
  context.ellipse(x, y, rx, ry, 0, 0, 2 * Math.PI);
  context.fill();
}

/**
 * @param row the step to draw, or undefined
 * @param fallAngle rad
 * @param geometry of the bicycle, as the cockpit tells it; undefined before, when there is none to draw
 */
export function drawBehind(canvas, row, fallAngle, geometry) {
  const { context, width, height } = begin(canvas);
  const ground = height - (width < NARROW ? 42 : 30);
  const scale = (ground - 22) / DIAL;
  const lean = Number.isFinite(row?.lean) ? row.lean : 0;
  const shift = Number.isFinite(row?.displacement) ? -row.displacement : 0;
  const steer = Number.isFinite(row?.steer) ? row.steer : 0;

  context.save();
  context.translate(width / 2, ground);
  line(context, colours.line, 1, [-width / 2 + 12, 0], [width / 2 - 12, 0]);
  const dial = DIAL * scale;
  context.setLineDash([3, 4]);
  for (const side of [-1, 1]) {
    const [x, y] = [side * Math.sin(fallAngle), -Math.cos(fallAngle)];
    line(context, colours.soft, 1.5, [0.5 * scale * x, 0.5 * scale * y], [dial * x, dial * y]);
  }
  context.setLineDash([]);
  // A scale from limit to limit, and on it how far the bicycle leans.
  const along = (from, to, colour, thick) => {
    context.strokeStyle = colour;
    context.lineWidth = thick;
    context.beginPath();
    context.arc(0, 0, dial, from - Math.PI / 2, to - Math.PI / 2, to < from);
    context.stroke();
  };
  along(-fallAngle, fallAngle, colours.line, 2);
  line(context, colours.soft, 1.5, [0, -dial - 4], [0, -dial + 4]);
  along(0, lean, row && Math.abs(lean) > fallAngle ? colours.bad : colours.accent, 4);

  context.rotate(lean);
  context.scale(scale, scale);
  if (geometry) drawRidden(context, geometry, steer, shift);
  context.restore();

  const text = sided(100 * row?.displacement, " cm", 1, "left", "right");
  labels(context, width, height, [["lean", sided(degrees(row?.lean), "°", 1, "right", "left")], ["rider", text]]);
  canvas.setAttribute("aria-label", `The bicycle from behind: lean ${sided(degrees(row?.lean), " degrees", 0, "right", "left")}, rider ${text}`);
}

/** Bicycle and rider from behind, upright on the ground at the origin, in m. */
function drawRidden(context, { rear_radius: rear, front_radius: front }, steer, shift) {
  // The front wheel shows its side when it is steered; the left grip comes back in a left turn.
  context.globalAlpha = 0.5;
  ellipse(context, colours.tyre, -0.08 * Math.sin(steer), -front, 0.03 + front * Math.abs(Math.sin(steer)), front);
  context.globalAlpha = 1;
  ellipse(context, colours.tyre, 0, -rear, 0.036, rear);
  line(context, colours.frame, 0.05, [0, -rear], [0, -0.88]);
  const [reach, turn] = [0.29 * Math.cos(steer), 0.1 * Math.sin(steer)];
  line(context, colours.tyre, 0.035, [-reach, -1.04 + turn], [reach, -1.04 - turn]);
  drawRider(context, shift, [[-reach, -1.05 + turn], [reach, -1.05 - turn]]);
}

/** The rider's middle is where the displacement says; hips stay nearer to the saddle. */
function drawRider(context, shift, grips) {
  const [hips, chest, head] = [[0.8 * shift, -0.92], [1.05 * shift, -1.36], [1.12 * shift, -1.64]];
  const sides = [-1, 1];
  for (const side of sides) {
    const pedal = [0.12 * side, -0.34 - 0.1 * side];
    line(context, colours.rider, 0.1, [hips[0] + 0.07 * side, hips[1]], [hips[0] / 2 + 0.14 * side, -0.66], pedal);
  }
  sides.forEach((side, index) => {
    const shoulder = [chest[0] + 0.17 * side, chest[1] - 0.02];
    const elbow = [(shoulder[0] + grips[index][0]) / 2 + 0.06 * side, -1.17];
    line(context, colours.rider, 0.075, shoulder, elbow, grips[index]);
  });
  context.fillStyle = context.strokeStyle = colours.rider;
  context.lineWidth = 0.09;
  context.beginPath();
  context.moveTo(hips[0] - 0.09, hips[1]);
  context.lineTo(chest[0] - 0.15, chest[1]);
  context.lineTo(chest[0] + 0.15, chest[1]);
  context.lineTo(hips[0] + 0.09, hips[1]);
  context.closePath();
  context.fill();
  context.stroke();
  ellipse(context, colours.rider, ...head, 0.095, 0.12);
}

/** @param geometry as for `drawBehind` */
export function drawAbove(canvas, row, geometry) {
  const { context, width, height } = begin(canvas);
  const scale = (height - (width < NARROW ? 76 : 62)) / 2.0;
  const steer = Number.isFinite(row?.steer) ? row.steer : 0;
  const lean = Number.isFinite(row?.lean) ? row.lean : 0;
  const shift = Number.isFinite(row?.displacement) ? -row.displacement : 0;

  context.save();
  context.translate(width / 2, height / 2 - 2);
  if (Number.isFinite(row?.heading_error)) goalArrow(context, row.heading_error, 1.13 * scale);
  context.scale(scale, scale);
  context.translate(0, 0.06);
  if (geometry) drawRiddenAbove(context, geometry, steer, lean, shift);
  context.restore();

  const steering = ["steer", sided(degrees(row?.steer), "°", 1, "left", "right")];
  const goal = Number.isFinite(row?.heading_error) ? [["goal", sided(degrees(row.heading_error), "°", 0, "left", "right")]] : [];
  labels(context, width, height, [steering, ...goal]);
  canvas.setAttribute("aria-label", `The bicycle from above: steering ${sided(degrees(row?.steer), " degrees", 0, "left", "right")}`);
}

/** Bicycle and rider from above, in m. */
function drawRiddenAbove(context, geometry, steer, lean, shift) {
  const [rear, front] = [geometry.wheelbase / 2, -geometry.wheelbase / 2];
  line(context, colours.tyre, 0.07, [0, rear - geometry.rear_radius], [0, rear + geometry.rear_radius]);
  line(context, colours.frame, 0.05, [0, rear], [0, front + 0.12]);
  context.save();
  context.translate(0, front);
  context.rotate(-steer);
  line(context, colours.tyre, 0.07, [0, -geometry.front_radius], [0, geometry.front_radius]);
  line(context, colours.tyre, 0.045, [-0.29, 0.2], [0.29, 0.2]);
  context.restore();
  // The rider's middle goes with the displacement, the head also with the lean.
  const tilt = Math.sin(lean);
  context.globalAlpha = 0.85;
  ellipse(context, colours.rider, shift + 0.9 * tilt * 0.5, 0.2, 0.21, 0.15);
  ellipse(context, colours.rider, shift * 1.15 + 1.4 * tilt * 0.5, 0.05, 0.11, 0.12);
  context.globalAlpha = 1;
}

/** Where the goal lies, on a circle round the bicycle. */
function goalArrow(context, error, radius) {
  context.strokeStyle = colours.line;
  context.lineWidth = 1;
  context.beginPath();
  context.arc(0, 0, radius, 0, 2 * Math.PI);
  context.stroke();
  context.save();
  context.rotate(-error);
  context.translate(0, -radius);
  context.fillStyle = colours.good;
  context.beginPath();
  context.moveTo(0, -8);
  context.lineTo(6, 5);
  context.lineTo(-6, 5);
  context.fill();
  context.restore();
}
