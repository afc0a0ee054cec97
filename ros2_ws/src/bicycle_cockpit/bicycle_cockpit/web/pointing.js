// Mouse, touch and keyboard on the map.

import { listenToFingers } from "./fingers.js";

const SLACK = 8;

/**
 * @param {HTMLCanvasElement} canvas
 * @param {View} view
 * @param handlers `goal(x, y, heading)`, `waypoint(x, y)`, `dragged({from, to} or null)`,
 *   `moved()` (the view), `mark([x, y])`, `start()` (where the mark begins), `adding()`
 */
export function listenTo(canvas, view, handlers) {
  listenToFingers(canvas, {
    down: (_, event) => ({ shift: event.shiftKey, pan: event.button !== 0 }),
    drag(press, at, before) {
      if (press.pan) {
        view.pan(at[0] - before[0], at[1] - before[1]);
        handlers.moved();
      } else if (press.far) handlers.dragged({ from: view.toWorld(...press.at), to: view.toWorld(...at) });
    },
    up(press, at) {
      if (press.pan) return;
      const [x, y] = view.toWorld(...press.at);
      const [tx, ty] = view.toWorld(...at);
      if (press.shift || handlers.adding()) handlers.waypoint(x, y);
      else handlers.goal(x, y, press.far ? Math.atan2(ty - y, tx - x) : null);
    },
    drop: () => handlers.dragged(null),
    pinch(factor, middle, by) {
      view.zoom(factor, ...middle);
      view.pan(...by);
      handlers.moved();
    },
    wheel(delta, at) {
      view.zoom(Math.exp(-0.0015 * delta), ...at);
      handlers.moved(false);
    },
  }, SLACK);

  let mark = null;
  const moves = { ArrowUp: [0, 1], ArrowDown: [0, -1], ArrowLeft: [-1, 0], ArrowRight: [1, 0] };
  canvas.addEventListener("keydown", (event) => {
    if (event.ctrlKey || event.metaKey || event.altKey) return;
    if (moves[event.key]) {
      const far = event.shiftKey ? 10 : 1;
      mark ??= handlers.start();
      mark = [mark[0] + far * moves[event.key][0], mark[1] + far * moves[event.key][1]];
      handlers.mark(mark);
    } else if (event.key === "Enter" && mark) {
      if (event.shiftKey || handlers.adding()) handlers.waypoint(...mark);
      else handlers.goal(...mark, null);
    } else return;
    event.preventDefault();
    event.stopPropagation();
  });
  canvas.addEventListener("blur", () => {
    mark = null;
    handlers.mark(null);
  });
}
