// All pictures and panels of the moment that is shown: of the live ride, or of a bag at its cursor.

import { drawAbove, drawBehind } from "./bike.js";
import { drawCharts } from "./charts.js";
import { estimateOf, offBy } from "./estimate.js";
import { drawHorizon } from "./horizon.js";
import { drawMap } from "./map.js";
import { LiveClock, rowAt } from "./motion.js";
import { colourOf, styleOf } from "./palette.js";
import { showHead, showLegend, showLoop, showReward, showTrainer } from "./panels.js";
import { colours } from "./theme.js";
import { alarmOf, showWho, tellBag, tellLive } from "./who.js";

const FALL = Math.PI / 6;
const byId = (id) => document.getElementById(id);

export class Pictures {
  /** @param {{live: Live, player: BagPlayer, fleet: Fleet, view: View, views: Views, chart: ChartWindow, comparison: Comparison}} of */
  constructor(of) {
    Object.assign(this, of);
    this.clock = new LiveClock();
    /** [x, y] in m of the mark that the keys move over the map; null without one. */
    this.mark = null;
    /** What is drawn on the map with the mouse; null without. */
    this.drag = null;
    /** What the cockpit said when it ended. */
    this.ended = "";
    /** ms, when the bicycle in 3D was drawn last. */
    this.lastStage = 0;
  }

  /** All that pictures need of the moment. */
  moment() {
    const { live, fleet } = this;
    const { bag } = this.player;
    const source = bag ?? live;
    const { series, riders, cursor } = source;
    const { facts } = live;
    const paints = riders.map(colourOf);
    const { hover } = this.chart;
    return {
      series, riders, cursor, row: cursor >= 0 ? series.row(cursor) : null,
      fallAngle: (bag ? bag.fallAngle : facts.fall_angle) ?? FALL,
      marks: source.marks, paint: (number) => paints[number] ?? colours.soft,
      geometry: bag ? bag.geometry : facts.geometry, goal: bag ? bag.goal : live.status.goal, ahead: bag ? [] : live.status.ahead,
      radius: bag ? bag.radius : facts.goal_radius ?? 1,
      path: bag ? bag.path : live.path,
      others: bag ? [] : fleet.others,
      pointed: hover === null || cursor < 0 ? null : rowAt(series, hover),
    };
  }

  /** What is said of who rides. */
  who() {
    const { bag } = this.player;
    return bag ? tellBag(bag) : tellLive(this.live, this.ended);
  }

  /** Everything but the bicycle in 3D. */
  draw() {
    const { live, chart } = this;
    const { bag } = this.player;
    const moment = this.moment();
    const { series, riders, cursor, row, fallAngle, paint } = moment;
    const { facts } = live;
    const ghost = this.comparison.at(moment, row ? row.t : 0);
    drawMap(byId("map"), this.view, {
      mark: this.mark, drag: this.drag, ...moment, ghost, whole: Boolean(bag),
      fallen: Math.abs(row?.lean) > fallAngle, clear: this.views.main === "map" ? underLegend() : 0,
    });
    drawHorizon(byId("horizon"), row ?? undefined, fallAngle);
    drawBehind(byId("behind"), row ?? undefined, fallAngle, moment.geometry);
    drawAbove(byId("above"), row ?? undefined, moment.geometry);
    drawCharts(chart.canvas, series, chart.end, paint, bag ? bag.pedals : facts.limits?.[2] > 0, { span: chart.span, now: row ? row.t : 0, hover: chart.hover, ghost });
    showGap(ghost ? this.comparison.words : "");
    showHead(bag ? "bag" : live.mode, row);
    const who = this.who();
    showWho(who, styleOf);
    showAlarm(who);
    showLoop(bag ? bag.loop : live.status.loop, row, bag ? undefined : live.status, facts.time_step, offBy(series, cursor), facts);
    showTrainer(live.trainer, live.training);
    showReward(series, cursor);
    showLegend(series.policiesIn(0, bag ? series.length - 1 : cursor).map((number) => riders[number]).filter(Boolean), styleOf);
  }

  /** The bicycle in 3D, between two rows where the moment is. */
  drawStage(now) {
    const { bag } = this.player;
    const moment = this.moment();
    const { series, cursor, paint } = moment;
    const time = bag ? bag.time : this.clock.at(cursor >= 0 ? series.t[cursor] : 0, now, Math.min(0.25, (now - this.lastStage) / 1000));
    const row = cursor >= 0 ? rowAt(series, time) : null;
    const other = this.comparison.at(moment, time);
    const ghost = other && other.cursor >= 0 ? { series: other.series, cursor: other.cursor, colour: other.colour, geometry: other.bag.geometry, row: rowAt(other.series, other.time) } : null;
    const guess = estimateOf(series);
    const estimate = guess?.known(cursor) ? { series: guess, cursor, colour: colours.ink, geometry: moment.geometry, row: rowAt(guess, time) } : null;
    this.views.stage.draw({ ...moment, row, jersey: paint(row?.policy), ghost, estimate }, now);
    this.lastStage = now;
  }
}

/** Where the legend over the map ends, px from the top. */
function underLegend() {
  const legend = byId("legend");
  return legend.offsetHeight && legend.offsetTop + legend.offsetHeight;
}

/** What the line below the head warns of, large over the picture. */
function showAlarm(who) {
  const text = alarmOf(who);
  const box = byId("alarm");
  box.hidden = !text;
  box.dataset.level = who.level;
  if (box.textContent !== text) box.textContent = text;
}

/** How far the ride is from its ghost. */
function showGap(text) {
  byId("gap").hidden = !text;
  if (text && byId("gap").textContent !== text) byId("gap").textContent = text;
}
