// Films of what is shown: by the button, or picture by picture for `report.sh --video`.

import { answer } from "./controls.js";
import { Film, save } from "./film.js";
import { shown } from "./panels.js";
import { alarmOf, labelOf } from "./who.js";

const byId = (id) => document.getElementById(id);

export class Filming {
  /** @param {Pictures} pictures that are filmed */
  constructor(pictures) {
    this.pictures = pictures;
    this.film = new Film(() => ({ stage: byId("stage"), map: byId("map"), main: pictures.views.main }), () => this.caption());
  }

  /** What a film says of the moment. */
  caption() {
    const { row, series, cursor, riders, paint } = this.pictures.moment();
    const number = cursor >= 0 ? series.policy[cursor] : NaN;
    const who = this.pictures.who();
    return {
      who: labelOf(riders[number]), colour: paint(number), level: who.level,
      facts: row ? `${shown(row.t, 1)} s   ${shown(row.speed, 1)} m/s   lean ${shown((row.lean * 180) / Math.PI, 0)}°` : "",
      alarm: alarmOf(who),
      gap: this.pictures.comparison.words,
    };
  }

  /** Begins a film, or ends the one that runs. */
  toggle() {
    if (this.film.running) return this.stop();
    if (!Film.type) return answer({ ok: false, message: "This browser makes no films: use report.sh --video on a bag." });
    const box = byId("ride").getBoundingClientRect();
    this.film.start(Math.round(1.5 * box.width), Math.round(1.5 * box.height), (file, ending) => {
      save(file, `bicycle-${new Date().toISOString().slice(0, 19).replaceAll(":", "-")}.${ending}`);
      answer({ ok: true, message: "The film is among your downloads." });
    });
    byId("film").setAttribute("aria-pressed", "true");
    byId("film").textContent = "Save film";
  }

  stop() {
    this.film.stop();
    byId("film").setAttribute("aria-pressed", "false");
    byId("film").textContent = "Film";
  }

  /** Takes a picture into the film that runs. */
  take() {
    this.film.take();
  }

  /** One picture of a film of a bag: a data URL. */
  frame(time, camera, kind) {
    const { player, views } = this.pictures;
    const { eye } = views.stage;
    if (eye.mode !== camera) eye.choose(camera);
    if (camera === "orbit") eye.azimuth = 0.35 * time - 2.3;
    player.seek(time);
    this.pictures.draw();
    this.pictures.drawStage(1000 * time);
    return this.film.compose(innerWidth, innerHeight).toDataURL(kind, 0.92);
  }
}
