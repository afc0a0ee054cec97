// Mouse, touch and keyboard on the map.

const SLACK = 8;

/**
 * @param {HTMLCanvasElement} canvas
 * @param {View} view
 * @param handlers `goal(x, y, heading)`, `waypoint(x, y)`, `dragged({from, to} or null)`,
 *   `moved()` (the view), `mark([x, y])`, `start()` (where the mark begins), `adding()`
 */
export function listenTo(canvas, view, handlers) {
  const fingers = new Map();
  let press = null;

  const place = (event) => {
    const box = canvas.getBoundingClientRect();
    return [event.clientX - box.left, event.clientY - box.top];
  };
  const drop = () => {
    press = null;
    handlers.dragged(null);
  };

  canvas.addEventListener("contextmenu", (event) => event.preventDefault());
  canvas.addEventListener("pointerdown", (event) => {
    canvas.setPointerCapture(event.pointerId);
    fingers.set(event.pointerId, place(event));
    if (fingers.size > 1) return drop();
    press = { at: place(event), shift: event.shiftKey, pan: event.button !== 0, far: false };
  });
  canvas.addEventListener("pointermove", (event) => {
    if (!fingers.has(event.pointerId)) return;
    const before = fingers.get(event.pointerId);
    const at = place(event);
    fingers.set(event.pointerId, at);
    if (fingers.size > 1) return pinch(event.pointerId, before, at);
    if (!press) return;
    if (press.pan) {
      view.pan(at[0] - before[0], at[1] - before[1]);
      handlers.moved();
      return;
    }
    press.far ||= Math.hypot(at[0] - press.at[0], at[1] - press.at[1]) > SLACK;
    if (press.far) handlers.dragged({ from: view.toWorld(...press.at), to: view.toWorld(...at) });
  });
  canvas.addEventListener("pointerup", (event) => {
    fingers.delete(event.pointerId);
    if (press && !press.pan) {
      const [x, y] = view.toWorld(...press.at);
      const [tx, ty] = view.toWorld(...place(event));
      if (press.shift || handlers.adding()) handlers.waypoint(x, y);
      else handlers.goal(x, y, press.far ? Math.atan2(ty - y, tx - x) : null);
    }
    drop();
  });
  canvas.addEventListener("pointercancel", (event) => {
    fingers.delete(event.pointerId);
    drop();
  });
  canvas.addEventListener("wheel", (event) => {
    event.preventDefault();
    view.zoom(Math.exp(-0.0015 * event.deltaY), ...place(event));
    handlers.moved(false);
  }, { passive: false });

  function pinch(moving, before, at) {
    const other = [...fingers].find(([id]) => id !== moving)[1];
    const apart = (point) => Math.hypot(point[0] - other[0], point[1] - other[1]);
    view.zoom(apart(at) / Math.max(1, apart(before)), (at[0] + other[0]) / 2, (at[1] + other[1]) / 2);
    view.pan((at[0] - before[0]) / 2, (at[1] - before[1]) / 2);
    handlers.moved();
  }

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
