// Mouse and fingers on a canvas: a press that moves and ends, two fingers that pinch, a wheel.

/**
 * @param {HTMLCanvasElement} canvas
 * @param handlers places are [x, y] in CSS pixels of the canvas: `down(at, event)` begins a press and returns its state,
 *   `drag(press, at, before)` with `press.at` and `press.far` (whether it has left where it began), `up(press, at)`,
 *   `drop()` after every end, `hover(at)`, `pinch(factor, middle, by)` (`by` is how far the middle moved), `wheel(delta, at)`
 * @param {number} slack pixels up to which a press stays a click
 */
export function listenToFingers(canvas, handlers, slack) {
  const fingers = new Map();
  let press = null;
  const place = (event) => {
    const box = canvas.getBoundingClientRect();
    return [event.clientX - box.left, event.clientY - box.top];
  };
  const drop = () => {
    press = null;
    handlers.drop();
  };
  canvas.addEventListener("contextmenu", (event) => event.preventDefault());
  canvas.addEventListener("pointerdown", (event) => {
    canvas.setPointerCapture(event.pointerId);
    const at = place(event);
    fingers.set(event.pointerId, at);
    if (fingers.size > 1) return drop();
    press = { at, far: false, ...handlers.down(at, event) };
  });
  canvas.addEventListener("pointermove", (event) => {
    const at = place(event);
    const before = fingers.get(event.pointerId);
    if (!before) return handlers.hover?.(at);
    fingers.set(event.pointerId, at);
    if (fingers.size > 1) {
      const other = [...fingers].find(([id]) => id !== event.pointerId)[1];
      const apart = (point) => Math.hypot(point[0] - other[0], point[1] - other[1]);
      const middle = [(at[0] + other[0]) / 2, (at[1] + other[1]) / 2];
      return handlers.pinch(apart(at) / Math.max(1, apart(before)), middle, [(at[0] - before[0]) / 2, (at[1] - before[1]) / 2]);
    }
    if (!press) return;
    press.far ||= Math.hypot(at[0] - press.at[0], at[1] - press.at[1]) > slack;
    handlers.drag(press, at, before);
  });
  canvas.addEventListener("pointerup", (event) => {
    fingers.delete(event.pointerId);
    if (press) handlers.up(press, place(event));
    drop();
  });
  canvas.addEventListener("pointercancel", (event) => {
    fingers.delete(event.pointerId);
    drop();
  });
  canvas.addEventListener("wheel", (event) => {
    event.preventDefault();
    handlers.wheel(event.deltaY, place(event));
  }, { passive: false });
}
