// Colours of the style sheet for the canvases, and canvases that are sharp on every screen.

const NAMES = ["page", "card", "ink", "soft", "line", "grid", "accent", "good", "warn", "bad",
  "p0", "p1", "p2", "p3", "p4", "p5", "tyre", "rider", "frame"];

export const colours = {};
export const FONT = '12px system-ui, -apple-system, "Segoe UI", Roboto, "DejaVu Sans", sans-serif';

function read() {
  const style = getComputedStyle(document.documentElement);
  for (const name of NAMES) colours[name] = style.getPropertyValue(`--${name}`).trim();
}

/** Calls `changed` when the colours change. */
export function watchTheme(changed) {
  read();
  matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => {
    read();
    changed();
  });
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
