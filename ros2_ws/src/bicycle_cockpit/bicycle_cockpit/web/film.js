// A film of what is shown: the 3D picture with the map and a caption, as WebM from the page or picture by picture.

import { FONT, colours } from "./theme.js";

const RATE = 30;
const TYPES = ["video/webm;codecs=vp9", "video/webm;codecs=vp8", "video/webm", "video/mp4"];
const LATER = 2000;

export class Film {
  /**
   * @param {() => {stage: HTMLCanvasElement, map: HTMLCanvasElement, main: string}} pictures
   * @param {() => {who: string, colour: string, facts: string, level: string, alarm: string}} words
   */
  constructor(pictures, words) {
    this.pictures = pictures;
    this.words = words;
    this.canvas = document.createElement("canvas");
    this.recorder = null;
  }

  /** Draws one picture of the film. */
  compose(width, height) {
    const { canvas } = this;
    if (canvas.width !== width || canvas.height !== height) [canvas.width, canvas.height] = [width, height];
    const context = canvas.getContext("2d");
    const { stage, map, main } = this.pictures();
    const [large, inset] = main === "3d" ? [stage, map] : [map, null];
    context.fillStyle = colours.card;
    context.fillRect(0, 0, width, height);
    cover(context, large, width, height);
    const unit = height / 540;
    if (inset?.width) {
      const wide = 0.24 * width;
      const high = (wide * inset.height) / inset.width;
      const [x, y] = [width - wide - 14 * unit, height - high - 14 * unit];
      context.globalAlpha = 0.88;
      context.fillStyle = colours.card;
      context.beginPath();
      context.roundRect(x, y, wide, high, 8 * unit);
      context.fill();
      context.globalAlpha = 1;
      context.drawImage(inset, x, y, wide, high);
    }
    this.caption(context, unit, width);
    return canvas;
  }

  caption(context, unit, width) {
    const { who, colour, facts, level, alarm, gap } = this.words();
    const font = (size, weight = "") => FONT.replace("12px", `${weight} ${Math.round(size * unit)}px`);
    const box = (text, x, y, size, weight, fill, ink, swatch = "") => {
      context.font = font(size, weight);
      const wide = context.measureText(text).width + (swatch ? 34 : 20) * unit;
      context.globalAlpha = 0.85;
      context.fillStyle = fill;
      context.beginPath();
      context.roundRect(x, y, wide, size * 1.75 * unit, 6 * unit);
      context.fill();
      context.globalAlpha = 1;
      if (swatch) {
        context.fillStyle = swatch;
        context.fillRect(x + 9 * unit, y + size * 0.78 * unit, 16 * unit, 4 * unit);
      }
      context.fillStyle = ink;
      context.fillText(text, x + (swatch ? 30 : 10) * unit, y + size * 1.22 * unit);
      return wide;
    };
    const edge = 14 * unit;
    let taken = who ? box(who, edge, edge, 19, "600", colours.card, colours.ink, colour) : 0;
    if (facts) taken = Math.max(taken, box(facts, edge, 54 * unit, 16, "", colours.card, colours.ink));
    if (gap) taken = Math.max(taken, box(gap, edge, 90 * unit, 16, "600", colours.card, colours.ink));
    if (!alarm) return;
    // In the sky beside the other words, where there is room, so that the rider is seen.
    context.font = font(17, "600");
    const free = width - (context.measureText(alarm).width + 20 * unit) - edge;
    const beside = free >= taken + 2 * edge;
    box(alarm, Math.max(edge, beside ? free : (free + edge) / 2), beside ? edge : (gap ? 128 : 92) * unit, 17, "600", level === "bad" ? colours.bad : colours.warn, colours.card);
  }

  get running() {
    return this.recorder !== null;
  }

  /** Whether this browser can make a film at all. */
  static get type() {
    return typeof MediaRecorder === "undefined" ? "" : TYPES.find((type) => MediaRecorder.isTypeSupported(type)) ?? "";
  }

  /** @param {(file: Blob, ending: string) => void} done takes the film */
  start(width, height, done) {
    const type = Film.type;
    this.size = [width - (width % 2), height - (height % 2)];
    this.compose(...this.size);
    const parts = [];
    const recorder = (this.recorder = new MediaRecorder(this.canvas.captureStream(RATE), { mimeType: type, videoBitsPerSecond: 8e6 }));
    recorder.ondataavailable = ({ data }) => parts.push(data);
    recorder.onstop = () => done(new Blob(parts, { type }), type.includes("mp4") ? "mp4" : "webm");
    recorder.start(500);
  }

  stop() {
    this.recorder?.stop();
    this.recorder = null;
  }

  /** Takes a picture into the film that runs. */
  take() {
    if (this.running) this.compose(...this.size);
  }
}

/** Fills a rectangle with a picture, cut where its shape is another. */
function cover(context, picture, width, height) {
  if (!picture.width || !picture.height) return;
  const scale = Math.max(width / picture.width, height / picture.height);
  const [w, h] = [width / scale, height / scale];
  context.drawImage(picture, (picture.width - w) / 2, (picture.height - h) / 2, w, h, 0, 0, width, height);
}

/** Hands a file to the person as a download. */
export function save(file, name) {
  const link = Object.assign(document.createElement("a"), { href: URL.createObjectURL(file), download: name });
  link.click();
  setTimeout(() => URL.revokeObjectURL(link.href), LATER);
}
