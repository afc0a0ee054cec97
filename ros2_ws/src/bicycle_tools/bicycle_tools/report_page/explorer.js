"use strict";
// Rides over each other: tracks and strips that share one time window and one cursor.
(() => {
  const box = document.querySelector(".explorer");
  if (!box) return;
  box.hidden = false;
  const { rides, strips } = JSON.parse(document.getElementById("rides").textContent);
  const plane = box.querySelector(".plane");
  const chart = box.querySelector(".strips");
  const moment = box.querySelector(".moment");
  const [GUTTER, RIGHT, TOP, FOOT, STRIP] = [110, 8, 20, 22, 62];
  const LEAST = 0.5;
  const FONT = '12px system-ui, "DejaVu Sans", sans-serif';
  const end = Math.max(1, ...rides.map(({ t }) => t[t.length - 1] || 0));
  let from = 0;
  let to = end;
  let cursor = null;
  chart.style.height = `${TOP + strips.length * STRIP + FOOT}px`;

  const colour = (name) => getComputedStyle(document.documentElement).getPropertyValue(`--${name}`).trim();
  const inks = () => ["ride0", "ride1", "ride2", "ride3"].map(colour);
  const MARKS = { reached: "reached", missed: "shift", fell: "failed", reset: "faint", push: "shift", "hand-over": "shift", "hand-back": "faint", "no command": "failed" };
  const SIGNS = { reached: "✓", missed: "×", fell: "▼", reset: "↺", push: "●", "hand-over": "◆", "hand-back": "◇", "no command": "!" };

  /** The row at or before a time. */
  function rowAt(t, time) {
    let [low, high] = [0, t.length];
    while (low < high) {
      const middle = (low + high) >> 1;
      if (t[middle] <= time) low = middle + 1;
      else high = middle;
    }
    return Math.max(0, low - 1);
  }

  function begin(canvas) {
    const ratio = Math.min(devicePixelRatio || 1, 2);
    const { clientWidth: width, clientHeight: height } = canvas;
    canvas.width = Math.round(width * ratio);
    canvas.height = Math.round(height * ratio);
    const context = canvas.getContext("2d");
    context.setTransform(ratio, 0, 0, ratio, 0, 0);
    context.clearRect(0, 0, width, height);
    context.font = FONT;
    context.lineJoin = "round";
    return { context, width, height };
  }

  const nice = (value) => {
    const power = 10 ** Math.floor(Math.log10(value || 1));
    return power * [1, 2, 5, 10].find((factor) => factor * power >= value * 0.999);
  };

  const gutter = () => (chart.clientWidth < 480 ? 100 : GUTTER);
  const px = (time) => gutter() + ((time - from) / (to - from)) * (chart.clientWidth - gutter() - RIGHT);
  const timeAt = (x) => from + ((x - gutter()) / (chart.clientWidth - gutter() - RIGHT)) * (to - from);

  /** Whether a ride was going on at the cursor. */
  const there = ({ t }) => cursor >= t[0] - 0.5 && cursor <= t[t.length - 1] + 0.5;

  function line(context, ride, values, first, last, x, y) {
    const breaks = new Set(ride.breaks);
    context.beginPath();
    let pen = false;
    for (let row = first; row <= last; row++) {
      if (values[row] === null || breaks.has(row)) pen = false;
      if (values[row] === null) continue;
      if (pen) context.lineTo(x(row), y(values[row]));
      else context.moveTo(x(row), y(values[row]));
      pen = true;
    }
    context.stroke();
  }

  function drawStrips() {
    const { context, width, height } = begin(chart);
    const [ink, faint, grid] = [colour("ink"), colour("faint"), colour("grid")];
    const shades = inks();
    const spans = rides.map(({ t }) => [rowAt(t, from), Math.min(t.length - 1, rowAt(t, to) + 1)]);
    const step = [0.1, 0.2, 0.5, 1, 2, 5, 10, 15, 30, 60, 120, 300, 600, 1800].find((one) => (to - from) / one <= (width < 480 ? 4 : 10)) || 3600;
    context.textAlign = "center";
    for (let t = Math.ceil(from / step) * step; t <= to; t += step) {
      context.strokeStyle = grid;
      context.beginPath();
      context.moveTo(px(t), TOP);
      context.lineTo(px(t), height - FOOT);
      context.stroke();
      context.fillStyle = faint;
      if (px(t) < width - 16) context.fillText(`${Number(t.toFixed(2))} s`, px(t), height - 7);
    }
    strips.forEach(({ name, unit, digits }, number) => {
      const top = TOP + number * STRIP;
      let [low, high] = [Infinity, -Infinity];
      rides.forEach((ride, n) => {
        for (const value of (ride.values[name] || []).slice(spans[n][0], spans[n][1] + 1)) {
          if (value === null) continue;
          low = Math.min(low, value);
          high = Math.max(high, value);
        }
      });
      if (!Number.isFinite(low)) [low, high] = [-1, 1];
      if (low < 0) high = nice(Math.max(high, -low));
      low = low < 0 ? -high : 0;
      high = nice(high) || 1;
      const y = (value) => top + STRIP - 6 - ((value - low) / (high - low)) * (STRIP - 12);
      context.strokeStyle = grid;
      for (const at of [top, y(0)]) {
        context.beginPath();
        context.moveTo(at === top ? 0 : gutter(), at);
        context.lineTo(width - RIGHT, at);
        context.stroke();
      }
      context.textAlign = "left";
      context.fillStyle = faint;
      context.fillText(name, 2, top + 15);
      context.fillText(`${low < 0 ? "±" : "0 … "}${high} ${unit}`, 2, top + STRIP - 6);
      context.save();
      context.beginPath();
      context.rect(gutter(), top, width - gutter() - RIGHT, STRIP);
      context.clip();
      context.lineWidth = 1.4;
      rides.forEach((ride, n) => {
        if (!ride.values[name]) return;
        context.strokeStyle = shades[n];
        line(context, ride, ride.values[name], ...spans[n], (row) => px(ride.t[row]), y);
      });
      context.restore();
      if (cursor === null) return;
      context.font = `600 ${FONT}`;
      rides.forEach((ride, n) => {
        const value = ride.values[name] && there(ride) ? ride.values[name][rowAt(ride.t, cursor)] : null;
        if (value === null || value === undefined) return;
        context.fillStyle = shades[n];
        context.fillText(value.toFixed(digits), 2 + n * 52, top + 32);
      });
      context.font = FONT;
    });
    context.textAlign = "center";
    rides.forEach((ride) => {
      for (const mark of ride.marks) {
        if (mark.t < from || mark.t > to) continue;
        context.fillStyle = colour(MARKS[mark.kind] || "faint");
        context.fillText(SIGNS[mark.kind] || "·", px(mark.t), 14);
      }
    });
    if (cursor !== null) {
      context.strokeStyle = ink;
      context.beginPath();
      context.moveTo(px(cursor), TOP);
      context.lineTo(px(cursor), height - FOOT);
      context.stroke();
    }
  }

  let placed = null;
  function drawPlane() {
    const { context, width, height } = begin(plane);
    const shades = inks();
    const whole = from <= 0 && to >= end;
    const places = [];
    rides.forEach((ride) => {
      const [first, last] = [rowAt(ride.t, from), rowAt(ride.t, to)];
      for (let row = first; row <= last; row++) if (ride.x[row] !== null) places.push([ride.x[row], ride.y[row]]);
      if (whole) for (const { x, y } of ride.goals) places.push([x, y]);
    });
    if (!places.length) return;
    const bounds = [0, 1].map((axis) => [Math.min(...places.map((p) => p[axis])), Math.max(...places.map((p) => p[axis]))]);
    const margin = 34;
    const scale = Math.min((width - 2 * margin) / Math.max(4, bounds[0][1] - bounds[0][0]), (height - 2 * margin) / Math.max(4, bounds[1][1] - bounds[1][0]));
    const middle = bounds.map(([low, high]) => (low + high) / 2);
    const x = (value) => width / 2 + (value - middle[0]) * scale;
    const y = (value) => height / 2 - (value - middle[1]) * scale;
    placed = { x, y };
    const step = [1, 2, 5, 10, 20, 50, 100, 200, 500].find((one) => one * scale >= 46) || 1000;
    context.strokeStyle = colour("grid");
    context.fillStyle = colour("faint");
    const [left, right] = [middle[0] - width / 2 / scale, middle[0] + width / 2 / scale];
    const [low, high] = [middle[1] - height / 2 / scale, middle[1] + height / 2 / scale];
    for (let at = Math.ceil(left / step) * step; at <= right; at += step) {
      context.beginPath();
      context.moveTo(x(at), 0);
      context.lineTo(x(at), height);
      context.stroke();
      context.fillText(`${at}`, x(at) + 3, height - 4);
    }
    for (let at = Math.ceil(low / step) * step; at <= high; at += step) {
      context.beginPath();
      context.moveTo(0, y(at));
      context.lineTo(width, y(at));
      context.stroke();
      context.fillText(`${at} m`, 3, y(at) - 3);
    }
    rides.forEach((ride, n) => {
      for (const goal of ride.goals) {
        context.strokeStyle = colour(goal.reached ? "reached" : "failed");
        context.lineWidth = 1;
        context.beginPath();
        context.arc(x(goal.x), y(goal.y), Math.max(4, ride.radius * scale), 0, 2 * Math.PI);
        context.stroke();
      }
      context.strokeStyle = shades[n];
      context.lineWidth = 2;
      line(context, ride, ride.y, rowAt(ride.t, from), rowAt(ride.t, to), (row) => x(ride.x[row]), y);
      context.textAlign = "center";
      for (const mark of ride.marks) {
        if (mark.t < from || mark.t > to || mark.kind === "reset") continue;
        context.fillStyle = colour(MARKS[mark.kind] || "faint");
        context.fillText(SIGNS[mark.kind] || "·", x(mark.x), y(mark.y) + 4);
      }
      context.textAlign = "left";
    });
    if (cursor === null) return;
    rides.forEach((ride, n) => {
      const row = rowAt(ride.t, cursor);
      if (ride.x[row] === null || !there(ride)) return;
      context.fillStyle = shades[n];
      context.strokeStyle = colour("paper");
      context.lineWidth = 2;
      context.beginPath();
      context.arc(x(ride.x[row]), y(ride.y[row]), 6, 0, 2 * Math.PI);
      context.fill();
      context.stroke();
    });
  }

  let waiting = false;
  function redraw() {
    if (waiting) return;
    waiting = true;
    requestAnimationFrame(() => {
      waiting = false;
      drawStrips();
      drawPlane();
    });
  }

  const near = (time) => rides.flatMap(({ marks, name }) => marks.map((mark) => ({ ...mark, name }))).filter(({ t }) => Math.abs(px(t) - px(time)) < 7);

  function point(time) {
    cursor = time === null ? null : Math.min(end, Math.max(0, time));
    box.dataset.cursor = cursor === null ? "" : cursor.toFixed(3);
    const found = cursor === null ? [] : near(cursor);
    const what = found.map(({ name, text }) => (rides.length > 1 ? `${name}: ${text}` : text)).join("; ");
    moment.textContent = cursor === null ? "" : `${cursor.toFixed(2)} s${what ? `: ${what}` : ""}`;
    redraw();
  }

  function show(first, last) {
    const span = Math.min(end, Math.max(LEAST, last - first));
    from = Math.min(end - span, Math.max(0, first));
    to = from + span;
    box.dataset.from = from.toFixed(3);
    box.dataset.to = to.toFixed(3);
    redraw();
  }

  function zoom(factor, around = cursor === null ? (from + to) / 2 : cursor) {
    show(around - (around - from) / factor, around + (to - around) / factor);
  }

  function toMark(by) {
    const times = rides.flatMap(({ marks }) => marks.map(({ t }) => t)).sort((a, b) => a - b);
    const here = cursor === null ? (by > 0 ? -1 : end + 1) : cursor;
    const next = by > 0 ? times.find((t) => t > here + 1e-3) : times.filter((t) => t < here - 1e-3).pop();
    if (next === undefined) return;
    if (next < from || next > to) show(next - (to - from) / 2, next + (to - from) / 2);
    point(next);
  }

  for (const button of box.querySelectorAll("[data-zoom]")) {
    button.addEventListener("click", () => (button.dataset.zoom === "all" ? show(0, end) : zoom(button.dataset.zoom === "in" ? 1.6 : 1 / 1.6)));
  }
  for (const button of box.querySelectorAll("[data-mark]")) button.addEventListener("click", () => toMark(Number(button.dataset.mark)));

  const fingers = new Map();
  const local = (event) => event.clientX - chart.getBoundingClientRect().left;
  chart.addEventListener("pointerdown", (event) => {
    chart.setPointerCapture(event.pointerId);
    fingers.set(event.pointerId, local(event));
    chart.focus({ preventScroll: true });
    const found = near(timeAt(local(event)))[0];
    point(found ? found.t : timeAt(local(event)));
  });
  chart.addEventListener("pointermove", (event) => {
    const at = local(event);
    const before = fingers.get(event.pointerId);
    if (before === undefined) return point(timeAt(at));
    fingers.set(event.pointerId, at);
    if (fingers.size > 1) {
      const [other] = [...fingers].filter(([id]) => id !== event.pointerId).map(([, place]) => place);
      zoom(Math.max(0.2, Math.abs(at - other) / Math.max(4, Math.abs(before - other))), timeAt((at + other) / 2));
    } else {
      const by = timeAt(before) - timeAt(at);
      show(from + by, to + by);
      point(timeAt(at));
    }
  });
  for (const kind of ["pointerup", "pointercancel"]) chart.addEventListener(kind, (event) => fingers.delete(event.pointerId));
  chart.addEventListener("wheel", (event) => {
    if (document.activeElement !== chart && !event.ctrlKey) return;
    event.preventDefault();
    zoom(Math.exp(-0.0015 * event.deltaY), timeAt(local(event)));
  }, { passive: false });
  chart.addEventListener("dblclick", () => show(0, end));
  chart.addEventListener("keydown", (event) => {
    if (event.ctrlKey || event.metaKey || event.altKey) return;
    const span = to - from;
    const here = cursor === null ? (from + to) / 2 : cursor;
    const by = { ArrowLeft: -1, ArrowRight: 1 }[event.key];
    if (by && event.shiftKey) show(from + (by * span) / 4, to + (by * span) / 4);
    else if (by) {
      const next = here + (by * span) / 100;
      if (next < from || next > to) show(from + (by * span) / 4, to + (by * span) / 4);
      point(next);
    } else if (event.key === "+" || event.key === "=") zoom(1.6);
    else if (event.key === "-") zoom(1 / 1.6);
    else if (event.key === "0") show(0, end);
    else if (event.key === "n" || event.key === "p") toMark(event.key === "n" ? 1 : -1);
    else if (event.key === "Escape") point(null);
    else return;
    event.preventDefault();
  });
  plane.addEventListener("click", (event) => {
    if (!placed) return;
    const area = plane.getBoundingClientRect();
    const [cx, cy] = [event.clientX - area.left, event.clientY - area.top];
    let best = [Infinity, null];
    for (const ride of rides) {
      for (let row = rowAt(ride.t, from); row <= rowAt(ride.t, to); row++) {
        if (ride.x[row] === null) continue;
        const far = Math.hypot(placed.x(ride.x[row]) - cx, placed.y(ride.y[row]) - cy);
        if (far < best[0]) best = [far, ride.t[row]];
      }
    }
    if (best[0] < 40) point(best[1]);
  });
  addEventListener("resize", redraw);
  matchMedia("(prefers-color-scheme: dark)").addEventListener("change", redraw);
  document.addEventListener("visibilitychange", redraw);
  // On a phone the still pictures are closed: this shows the same, readable.
  if (innerWidth <= 640) for (const one of document.querySelectorAll("details.still")) one.open = false;
  show(0, end);
})();
