// Colours of the style sheet for the canvases, and canvases that are sharp on every screen.

const POLICIES = 10;
const NAMES = ["page", "card", "ink", "soft", "line", "grid", "accent", "good", "warn", "bad", "tyre", "rider", "frame",
  "ground", "groundline", "groundedge", "skycolour", "skylight", "sunlight", "policy-lightness",
  ...Array.from({ length: POLICIES }, (_, slot) => `p${slot}`)];
/** Degrees of the colour circle that the goal's green keeps for itself. */
const [GREEN_FROM, GREEN_TO] = [125, 180];
const GOLDEN = 137.508;

export const colours = {};
export const FONT = '12px system-ui, -apple-system, "Segoe UI", Roboto, "DejaVu Sans", sans-serif';

const dark = matchMedia("(prefers-color-scheme: dark)");
let wasDark = dark.matches;

function read() {
  wasDark = dark.matches;
  const style = getComputedStyle(document.documentElement);
  for (const name of NAMES) colours[name] = style.getPropertyValue(`--${name}`).trim();
}

/** Calls `changed` when the colours change; returns what to call before each picture. */
export function watchTheme(changed) {
  read();
  const look = () => {
    const before = JSON.stringify(colours);
    read();
    if (JSON.stringify(colours) !== before) changed();
  };
  dark.addEventListener("change", look);
  // Browsers do not tell a tab in the background that the scheme changes.
  document.addEventListener("visibilitychange", look);
  addEventListener("focus", look);
  // A page that is not in front may never be told of a change, though its query knows the scheme.
  return () => dark.matches !== wasDark && look();
}

/** The colour of a policy by its number in the palette; beyond the named ones, never the same twice. */
export function policyColour(slot) {
  if (!Number.isInteger(slot)) return colours.soft;
  return slot < POLICIES ? colours[`p${slot}`] : furtherColour(slot, colours["policy-lightness"]);
}

/** The same for an element's style, which follows the scheme by itself. */
export function policyStyle(slot) {
  if (!Number.isInteger(slot)) return "var(--soft)";
  return slot < POLICIES ? `var(--p${slot})` : furtherColour(slot, "var(--policy-lightness)");
}

function furtherColour(slot, lightness) {
  const hue = (GREEN_TO + ((slot * GOLDEN) % (360 - GREEN_TO + GREEN_FROM))) % 360;
  return `oklch(${lightness} 0.11 ${hue.toFixed(1)})`;
}

/** The context of a canvas cleared and scaled so that one unit is one CSS pixel, and its size. */
export function begin(canvas) {
  const { clientWidth: width, clientHeight: height } = canvas;
  const ratio = Math.min(window.devicePixelRatio || 1, 2);
  const [w, h] = [Math.round(width * ratio), Math.round(height * ratio)];
  if (canvas.width !== w || canvas.height !== h) [canvas.width, canvas.height] = [w, h];
  const context = canvas.getContext("2d");
  context.setTransform(ratio, 0, 0, ratio, 0, 0);
  context.clearRect(0, 0, width, height);
  context.font = FONT;
  context.lineJoin = context.lineCap = "round";
  return { context, width, height };
}
