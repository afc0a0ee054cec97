// The time that the charts show: how long it is, where it ends, and the moment under the mouse.

import { SPAN, spanOf, timeAt } from "./charts.js";

export class ChartWindow {
  /**
   * @param {HTMLCanvasElement} canvas of the charts
   * @param {HTMLSelectElement} choice of the span
   * @param {() => Bag | Live} source what is shown
   * @param {{seek: (time: number) => void, changed: () => void}} on `seek` when a moment is clicked
   */
  constructor(canvas, choice, source, on) {
    Object.assign(this, { canvas, choice, source, on });
    /** s that the charts show. */
    this.span = SPAN;
    /** s, the moment under the mouse; null elsewhere. */
    this.hover = null;
    canvas.addEventListener("pointermove", (event) => this.point(this.timeOf(event)));
    canvas.addEventListener("pointerleave", () => this.point(null));
    canvas.addEventListener("click", (event) => {
      const time = this.timeOf(event);
      if (time !== null) on.seek(time);
    });
    canvas.addEventListener("wheel", (event) => {
      event.preventDefault();
      this.show(this.span * Math.exp(0.0015 * event.deltaY));
    }, { passive: false });
    choice.addEventListener("change", () => this.show(Number(choice.value)));
  }

  /** s at the right end. */
  get end() {
    const { series, cursor, duration } = this.source();
    const now = cursor >= 0 ? series.t[cursor] : 0;
    // A bag is known beyond its cursor: a window that is longer than what was ridden shows what comes.
    return duration === undefined ? now : Math.min(duration, Math.max(now, this.span));
  }

  timeOf(event) {
    return timeAt(this.canvas, event.clientX - this.canvas.getBoundingClientRect().left, this.end, this.span);
  }

  point(time) {
    this.hover = time;
    this.on.changed();
  }

  /** Shows this many seconds; a span that is not among the choices becomes one. */
  show(seconds) {
    this.span = spanOf(seconds);
    const { choice } = this;
    const options = [...choice.options];
    const rounded = String(Math.round(this.span));
    if (!options.some(({ value }) => value === rounded)) {
      options.find(({ dataset }) => dataset.own)?.remove();
      const own = new Option(`${rounded} s`, rounded);
      own.dataset.own = "1";
      choice.append(own);
    }
    choice.value = rounded;
    this.on.changed();
  }
}
