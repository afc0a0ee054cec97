// Metres of the plane to pixels of the map and back; y points up on the map.

const MOST_SCALE = 120;
const LEAST_SCALE = 0.3;

export class View {
  constructor() {
    this.x = 0;
    this.y = 0;
    this.scale = 9;
    this.width = this.height = 1;
    this.following = true;
    this.bounds = null;
  }

  /** Takes a new size; what was fitted into the old one is fitted again, unless it was moved since. */
  sized(width, height) {
    const changed = width !== this.width || height !== this.height;
    [this.width, this.height] = [width, height];
    if (changed && this.bounds) this.refit();
  }

  toScreen(x, y) {
    return [this.width / 2 + (x - this.x) * this.scale, this.height / 2 - (y - this.y) * this.scale];
  }

  toWorld(px, py) {
    return [this.x + (px - this.width / 2) / this.scale, this.y - (py - this.height / 2) / this.scale];
  }

  pan(dx, dy) {
    this.bounds = null;
    this.x -= dx / this.scale;
    this.y += dy / this.scale;
  }

  /** Zooms about a point of the screen, which stays where it is. */
  zoom(factor, px = this.width / 2, py = this.height / 2) {
    this.bounds = null;
    const [x, y] = this.toWorld(px, py);
    this.scale = Math.min(MOST_SCALE, Math.max(LEAST_SCALE, this.scale * factor));
    const [nx, ny] = this.toWorld(px, py);
    this.x += x - nx;
    this.y += y - ny;
  }

  /** Keeps a point out of the outer quarter of the map. */
  follow(x, y) {
    if (!this.following || !Number.isFinite(x)) return;
    this.bounds = null;
    const [reach, rise] = [this.width / this.scale / 4, this.height / this.scale / 4];
    this.x = Math.min(x + reach, Math.max(x - reach, this.x));
    this.y = Math.min(y + rise, Math.max(y - rise, this.y));
  }

  /** Shows a whole rectangle. */
  fit(xs, ys) {
    const finite = (values) => values.filter(Number.isFinite);
    const bounds = (values) => values.reduce(([low, high], v) => [Math.min(low, v), Math.max(high, v)], [Infinity, -Infinity]);
    const [x0, x1] = bounds(finite(xs));
    const [y0, y1] = bounds(finite(ys));
    if (!(x1 >= x0)) return;
    this.bounds = [x0, x1, y0, y1];
    this.refit();
  }

  refit() {
    const [x0, x1, y0, y1] = this.bounds;
    [this.x, this.y] = [(x0 + x1) / 2, (y0 + y1) / 2];
    const room = Math.min(this.width / (x1 - x0 + 16), this.height / (y1 - y0 + 16));
    this.scale = Math.min(30, Math.max(LEAST_SCALE, room));
  }
}
