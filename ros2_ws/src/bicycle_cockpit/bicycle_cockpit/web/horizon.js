// An artificial horizon: the ground tilts as the rider sees it, and beyond the fall limit the scale is red.

import { FONT, begin, colours } from "./theme.js";

const LONG = 18;

/** @param row the step, or undefined @param {number} fallAngle rad */
export function drawHorizon(canvas, row, fallAngle) {
  if (!canvas.clientWidth) return;
  const { context, width, height } = begin(canvas);
  const lean = Number.isFinite(row?.lean) ? row.lean : 0;
  const radius = Math.min(width, height) / 2 - 4;
  context.translate(width / 2, height / 2);
  context.save();
  context.beginPath();
  context.arc(0, 0, radius - 7, 0, 2 * Math.PI);
  context.clip();
  context.rotate(-lean);
  context.fillStyle = colours.skycolour;
  context.fillRect(-radius, -radius, 2 * radius, 2 * radius);
  context.fillStyle = colours.groundedge;
  context.fillRect(-radius, 0, 2 * radius, radius);
  context.strokeStyle = colours.ink;
  context.lineWidth = 1.5;
  context.beginPath();
  context.moveTo(-radius, 0);
  context.lineTo(radius, 0);
  context.stroke();
  context.restore();
  // The scale stands still; its needle leans. Up to the limit it is calm, beyond it is red.
  const arc = (from, to, colour, thick) => {
    context.strokeStyle = colour;
    context.lineWidth = thick;
    context.beginPath();
    context.arc(0, 0, radius - 3, from - Math.PI / 2, to - Math.PI / 2);
    context.stroke();
  };
  context.lineCap = "butt";
  arc(-fallAngle, fallAngle, colours.good, 4);
  arc(fallAngle, fallAngle + 0.7, colours.bad, 6);
  arc(-fallAngle - 0.7, -fallAngle, colours.bad, 6);
  context.rotate(lean);
  context.fillStyle = Math.abs(lean) > 0.75 * fallAngle ? colours.bad : colours.ink;
  context.beginPath();
  context.moveTo(0, -radius + 3);
  context.lineTo(6, -radius + 14);
  context.lineTo(-6, -radius + 14);
  context.fill();
  context.rotate(-lean);
  context.strokeStyle = colours.ink;
  context.lineWidth = 3;
  context.beginPath();
  for (const side of [-1, 1]) {
    context.moveTo(side * LONG, 0);
    context.lineTo(side * 6, 0);
    context.lineTo(side * 6, 5);
  }
  context.stroke();
  context.fillStyle = colours.ink;
  context.textAlign = "center";
  context.font = `600 ${FONT}`;
  const shown = Math.abs((lean * 180) / Math.PI).toFixed(1);
  if (row) context.fillText(`${shown}°${Number(shown) ? (lean > 0 ? " R" : " L") : ""}`, 0, radius * 0.62);
  context.textAlign = "left";
}
