// Mouse and touch on the 3D picture: click for a goal, drag to turn around the bicycle, drag the rider to push it.

import { listenToFingers } from "../fingers.js";

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
  const rate = (press, at) => pushOf(at[0] - press.at[0]) * stage().rightward;
  listenToFingers(canvas, {
    down(at, event) {
      const found = stage().hit(...at);
      const main = event.button === 0;
      return { shift: event.shiftKey, place: found.place, rider: main && found.rider && handlers.pushable(), main };
    },
    hover: (at) => canvas.classList.toggle("grab", handlers.pushable() && stage().hit(...at).rider),
    drag(press, at, before) {
      if (!press.far) return;
      if (press.rider) handlers.pulled({ from: press.at, to: at, rate: rate(press, at) });
      else {
        stage().eye.turn(TURN * (at[0] - before[0]), TURN * (at[1] - before[1]));
        handlers.moved(true);
      }
    },
    up(press, at) {
      if (press.rider && press.far) {
        if (rate(press, at)) handlers.push(rate(press, at));
      } else if (!press.far && press.main && press.place && !press.rider) {
        const [x, y] = press.place.map((value) => Math.round(100 * value) / 100);
        if (press.shift || handlers.adding()) handlers.waypoint(x, y);
        else handlers.goal(x, y);
      }
    },
    drop: () => handlers.pulled(null),
    pinch(factor) {
      stage().eye.zoom(factor);
      handlers.moved();
    },
    wheel(delta) {
      stage().eye.zoom(Math.exp(-0.0012 * delta));
      handlers.moved();
    },
  }, SLACK);
}
