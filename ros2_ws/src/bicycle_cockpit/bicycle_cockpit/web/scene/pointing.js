// Mouse and touch on the 3D picture: click for a goal, drag to turn around the bicycle, drag the rider to push it.

const SLACK = 6;
/** rad of the camera in a drag of one pixel. */
const TURN = 0.007;
/** Pixels of a drag for a push of 1 rad/s, and the least and the most that one pushes. */
const PULL = 160;
const [LEAST, MOST] = [0.05, 1];

/** The lean rate that a drag stands for, rad/s, positive to the right on the picture. */
export function pushOf(across) {
  const rate = Math.min(MOST, Math.abs(across) / PULL);
  return rate < LEAST ? 0 : Math.sign(across) * Math.round(20 * rate) / 20;
}

/**
 * @param {HTMLCanvasElement} canvas
 * @param {() => Stage} stage
 * @param handlers `goal(x, y)`, `waypoint(x, y)`, `push(lean_rate)` (rad/s to the bicycle's right), `pulled({from, to, rate} or null)`,
 *   `moved()`, `adding()`, `pushable()`
 */
export function listenToStage(canvas, stage, handlers) {
  const fingers = new Map();
  let press = null;
  const place = (event) => {
    const box = canvas.getBoundingClientRect();
    return [event.clientX - box.left, event.clientY - box.top];
  };
  const drop = () => {
    press = null;
    handlers.pulled(null);
  };
  canvas.addEventListener("contextmenu", (event) => event.preventDefault());
  canvas.addEventListener("pointerdown", (event) => {
    canvas.setPointerCapture(event.pointerId);
    const at = place(event);
    fingers.set(event.pointerId, at);
    if (fingers.size > 1) return drop();
    const found = stage().hit(...at);
    press = { at, far: false, shift: event.shiftKey, place: found.place, rider: event.button === 0 && found.rider && handlers.pushable(), main: event.button === 0 };
  });
  canvas.addEventListener("pointermove", (event) => {
    if (!fingers.has(event.pointerId)) {
      canvas.classList.toggle("grab", handlers.pushable() && stage().hit(...place(event)).rider);
      return;
    }
    const before = fingers.get(event.pointerId);
    const at = place(event);
    fingers.set(event.pointerId, at);
    if (fingers.size > 1) {
      const other = [...fingers].find(([id]) => id !== event.pointerId)[1];
      const apart = (point) => Math.hypot(point[0] - other[0], point[1] - other[1]);
      stage().eye.zoom(apart(at) / Math.max(1, apart(before)));
      return handlers.moved();
    }
    if (!press) return;
    press.far ||= Math.hypot(at[0] - press.at[0], at[1] - press.at[1]) > SLACK;
    if (!press.far) return;
    if (press.rider) handlers.pulled({ from: press.at, to: at, rate: pushOf(at[0] - press.at[0]) * stage().rightward });
    else {
      stage().eye.turn(TURN * (at[0] - before[0]), TURN * (at[1] - before[1]));
      handlers.moved(true);
    }
  });
  canvas.addEventListener("pointerup", (event) => {
    fingers.delete(event.pointerId);
    if (press?.rider && press.far) {
      const rate = pushOf(place(event)[0] - press.at[0]) * stage().rightward;
      if (rate) handlers.push(rate);
    } else if (press && !press.far && press.main && press.place && !press.rider) {
      const [x, y] = press.place.map((value) => Math.round(100 * value) / 100);
      if (press.shift || handlers.adding()) handlers.waypoint(x, y);
      else handlers.goal(x, y);
    }
    drop();
  });
  canvas.addEventListener("pointercancel", (event) => {
    fingers.delete(event.pointerId);
    drop();
  });
  canvas.addEventListener("wheel", (event) => {
    event.preventDefault();
    stage().eye.zoom(Math.exp(-0.0012 * event.deltaY));
    handlers.moved();
  }, { passive: false });
}
