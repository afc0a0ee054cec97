// What stands around the bicycle: ground, sky, light, goals, the way ahead, marks, and the trail that fades.

import * as THREE from "../vendor/three.module.min.js";
import { colours, FONT } from "../theme.js";

const TILE = 10;
const TILES = 60;
/** s of the trail, and how many points it may have. */
const TRAIL = 60;
const MOST = 900;
const WIDE = 0.045;

/** One square of 10 m with a line at each metre. */
function tile() {
  const side = 1024;
  const canvas = Object.assign(document.createElement("canvas"), { width: side, height: side });
  const context = canvas.getContext("2d");
  const paint = () => {
    context.fillStyle = colours.ground;
    context.fillRect(0, 0, side, side);
    for (let metre = 0; metre < TILE; metre++) {
      const at = (metre * side) / TILE;
      context.fillStyle = metre ? colours.groundline : colours.groundedge;
      const width = metre ? 2.5 : 6;
      context.fillRect(at - width / 2, 0, width, side);
      context.fillRect(0, at - width / 2, side, width);
      if (!metre) {
        context.fillRect(side - width / 2, 0, width, side);
        context.fillRect(0, side - width / 2, side, width);
      }
    }
  };
  paint();
  return { canvas, paint };
}

/** A number or a name on a small round sign. */
function sign(text, colour) {
  const canvas = Object.assign(document.createElement("canvas"), { width: 128, height: 128 });
  const context = canvas.getContext("2d");
  context.fillStyle = colour;
  context.beginPath();
  context.arc(64, 64, 58, 0, 2 * Math.PI);
  context.fill();
  context.fillStyle = "#ffffff";
  context.font = FONT.replace("12px", "bold 72px");
  context.textAlign = "center";
  context.fillText(text, 64, 90);
  const made = new THREE.Sprite(new THREE.SpriteMaterial({ map: new THREE.CanvasTexture(canvas) }));
  made.material.map.colorSpace = THREE.SRGBColorSpace;
  made.scale.set(0.7, 0.7, 1);
  return made;
}

/** A band on the ground with a colour and an opacity at each point. */
class Band {
  constructor(width) {
    this.width = width;
    const geometry = new THREE.BufferGeometry();
    this.places = new THREE.BufferAttribute(new Float32Array(6 * MOST), 3);
    this.colours = new THREE.BufferAttribute(new Float32Array(8 * MOST), 4);
    geometry.setAttribute("position", this.places);
    geometry.setAttribute("color", this.colours);
    const index = [];
    for (let n = 0; n + 1 < MOST; n++) index.push(2 * n, 2 * n + 1, 2 * n + 2, 2 * n + 1, 2 * n + 3, 2 * n + 2);
    geometry.setIndex(index);
    const material = new THREE.MeshBasicMaterial({ vertexColors: true, transparent: true, depthWrite: false, side: THREE.DoubleSide, polygonOffset: true, polygonOffsetFactor: -2, polygonOffsetUnits: -2 });
    this.mesh = new THREE.Mesh(geometry, material);
    this.mesh.frustumCulled = this.mesh.visible = false;
  }

  /** @param points `{x, y, colour: THREE.Color, opacity, broken}`, at most MOST */
  draw(points) {
    const { places, colours: shades, width } = this;
    let faces = 0;
    const index = this.mesh.geometry.index.array;
    points.forEach((point, n) => {
      const before = points[n && !point.broken ? n - 1 : n];
      const after = points[n + 1] && !points[n + 1].broken ? points[n + 1] : point;
      const [dx, dy] = [after.x - before.x, after.y - before.y];
      const length = Math.hypot(dx, dy) || 1;
      const [nx, ny] = [(-dy / length) * width, (dx / length) * width];
      places.setXYZ(2 * n, point.x + nx, point.y + ny, 0.01);
      places.setXYZ(2 * n + 1, point.x - nx, point.y - ny, 0.01);
      const { r, g, b } = point.colour;
      shades.setXYZW(2 * n, r, g, b, point.opacity);
      shades.setXYZW(2 * n + 1, r, g, b, point.opacity);
      if (n && !point.broken) index.set([2 * n - 2, 2 * n - 1, 2 * n, 2 * n - 1, 2 * n + 1, 2 * n], 6 * faces++);
    });
    places.needsUpdate = shades.needsUpdate = this.mesh.geometry.index.needsUpdate = true;
    this.mesh.geometry.setDrawRange(0, 6 * faces);
    this.mesh.visible = faces > 0;
  }
}

export class World {
  constructor() {
    this.scene = new THREE.Scene();
    this.scene.fog = new THREE.Fog("#ffffff", 25, 150);
    this.scene.background = new THREE.Color();
    this.sky = new THREE.HemisphereLight("#ffffff", "#b8b2a6", 1.5);
    this.sun = new THREE.DirectionalLight("#fff4e0", 2.2);
    this.sun.castShadow = true;
    this.sun.shadow.mapSize.set(1024, 1024);
    this.sun.shadow.radius = 4;
    this.sun.shadow.bias = -0.0008;
    Object.assign(this.sun.shadow.camera, { left: -2.2, right: 2.2, top: 2.2, bottom: -2.2, near: 1, far: 14 });
    this.tile = tile();
    this.texture = new THREE.CanvasTexture(this.tile.canvas);
    this.texture.wrapS = this.texture.wrapT = THREE.RepeatWrapping;
    this.texture.repeat.set(TILES, TILES);
    this.texture.colorSpace = THREE.SRGBColorSpace;
    this.ground = new THREE.Mesh(new THREE.PlaneGeometry(TILE * TILES, TILE * TILES), new THREE.MeshLambertMaterial({ map: this.texture }));
    this.ground.receiveShadow = true;
    this.trail = new Band(WIDE);
    this.other = new Band(WIDE);
    this.estimated = new Band(WIDE / 2);
    this.course = new Band(0.12);
    this.shownCourse = null;
    this.goals = new THREE.Group();
    this.marks = new THREE.Group();
    this.shownGoals = this.shownMarks = "";
    const dash = new THREE.LineDashedMaterial({ dashSize: 0.5, gapSize: 0.4, transparent: true, opacity: 0.8 });
    this.way = new THREE.Line(new THREE.BufferGeometry(), dash);
    this.way.frustumCulled = false;
    this.spot = new THREE.Mesh(new THREE.RingGeometry(0.18, 0.28, 32), new THREE.MeshBasicMaterial({ side: THREE.DoubleSide }));
    this.spot.position.z = 0.03;
    this.scene.add(this.spot, this.course.mesh, this.sky, this.sun, this.sun.target, this.ground, this.trail.mesh, this.other.mesh, this.estimated.mesh, this.goals, this.marks, this.way);
    this.themed();
  }

  /** Takes the colours of the style sheet. */
  themed() {
    this.tile.paint();
    this.texture.needsUpdate = true;
    this.scene.background.set(colours.skycolour);
    this.scene.fog.color.set(colours.skycolour);
    this.sky.intensity = Number(colours.skylight) || 1.5;
    this.sun.intensity = Number(colours.sunlight) || 2.2;
    this.way.material.color.set(colours.good);
    this.spot.material.color.set(colours.accent);
    this.shownGoals = this.shownMarks = "";
  }

  /** Far lines of the ground sharp or cheap: a processor that draws takes two thirds of its time for the sharp ones. */
  sharpen(sharp) {
    this.texture.anisotropy = sharp ? 8 : 1;
    this.texture.minFilter = sharp ? THREE.LinearMipmapLinearFilter : THREE.LinearMipmapNearestFilter;
    this.texture.needsUpdate = true;
  }

  /** Light and ground go with the bicycle. */
  centre(x, y) {
    this.ground.position.set(TILE * Math.round(x / TILE), TILE * Math.round(y / TILE), 0);
    this.sun.target.position.set(x, y, 0.6);
    this.sun.position.set(x - 3, y - 3.2, 6.2);
  }

  /** The place at the moment that is pointed at, or none. */
  point(row) {
    this.spot.visible = Number.isFinite(row?.x);
    if (this.spot.visible) Object.assign(this.spot.position, { x: row.x, y: row.y });
  }

  /** The path that is followed, [x, y] of its points. */
  follow(points) {
    if (points === this.shownCourse) return;
    this.shownCourse = points;
    const colour = new THREE.Color(colours.good);
    const stride = Math.max(1, Math.ceil(points.length / (MOST - 2)));
    this.course.draw(points.filter((_, n) => n % stride === 0).map(([x, y]) => ({ x, y, colour, opacity: 0.35 })));
  }

  /** @param points of the goals, [x, y], the active one first @param radius m @param from where the bicycle is */
  aim(points, radius, from, active) {
    const wanted = JSON.stringify([points, radius, active]);
    if (wanted !== this.shownGoals) {
      this.shownGoals = wanted;
      clear(this.goals);
      points.forEach(([x, y, heading], index) => {
        const made = goal(x, y, radius, index, points.length, active && index === 0);
        if (Number.isFinite(heading)) made.add(arrow(radius, heading));
        this.goals.add(made);
      });
    }
    const way = [...(from ? [from] : []), ...points].map(([x, y]) => new THREE.Vector3(x, y, 0.02));
    this.way.visible = points.length > 0 && way.length > 1;
    if (!this.way.visible) return;
    this.way.geometry.dispose();
    this.way.geometry = new THREE.BufferGeometry().setFromPoints(way);
    this.way.computeLineDistances();
  }

  /** Falls, pushes, hand-overs and reached goals, where they happened. */
  mark(marks, radius) {
    const wanted = `${radius} ${marks.length} ${marks.at(-1)?.t}`;
    if (wanted === this.shownMarks) return;
    this.shownMarks = wanted;
    clear(this.marks);
    for (const { kind, x, y } of marks.slice(-60)) {
      const made = signOf(kind, radius);
      if (!made || !Number.isFinite(x)) continue;
      made.position.x = x;
      made.position.y = y;
      this.marks.add(made);
    }
  }

  /** The trail up to a row; the older, the fainter. `here` is where the bicycle is drawn. */
  track(band, series, cursor, paint, here) {
    if (cursor < 0) return band.draw([]);
    const now = series.t[cursor];
    const first = series.indexAt(now - TRAIL);
    const stride = Math.max(1, Math.ceil((cursor - first) / (MOST - 4)));
    const points = [];
    let shade = null;
    let policy = null;
    for (let index = first; index <= cursor; index += stride) {
      if (!Number.isFinite(series.x[index])) continue;
      if (!shade || series.policy[index] !== policy) shade = new THREE.Color(paint((policy = series.policy[index])));
      points.push({ x: series.x[index], y: series.y[index], colour: shade, opacity: 0.9 * (1 - (now - series.t[index]) / TRAIL),
        broken: index > first && !Number.isFinite(series.x[index - stride]) || index > first && series.t[index] - series.t[index - stride] > 1 + 0.05 * stride || index > first && series.episode[index] !== series.episode[index - stride] });
    }
    if (here && points.length && Number.isFinite(here.x)) points.push({ x: here.x, y: here.y, colour: shade, opacity: 0.9, broken: Math.hypot(here.x - points.at(-1).x, here.y - points.at(-1).y) > 3 });
    band.draw(points);
  }
}

function clear(group) {
  group.traverse((part) => {
    part.geometry?.dispose();
    part.material?.map?.dispose();
    part.material?.dispose();
  });
  group.clear();
}

function goal(x, y, radius, index, many, active) {
  const made = new THREE.Group();
  const paint = new THREE.MeshBasicMaterial({ color: colours.good, transparent: true, opacity: active ? 0.85 : 0.4, side: THREE.DoubleSide });
  const edge = new THREE.Mesh(new THREE.RingGeometry(Math.max(0.05, radius - 0.08), radius, 64), paint);
  const disc = new THREE.Mesh(new THREE.CircleGeometry(radius, 48), new THREE.MeshBasicMaterial({ color: colours.good, transparent: true, opacity: active ? 0.16 : 0.07 }));
  edge.position.z = 0.016;
  disc.position.z = 0.014;
  const post = new THREE.Mesh(new THREE.CylinderGeometry(0.02, 0.02, 2.2, 8), new THREE.MeshStandardMaterial({ color: "#d8d8d4" }));
  post.rotation.x = Math.PI / 2;
  post.position.z = 1.1;
  const flag = new THREE.Mesh(new THREE.PlaneGeometry(0.6, 0.36), new THREE.MeshStandardMaterial({ color: colours.good, side: THREE.DoubleSide }));
  flag.rotation.x = Math.PI / 2;
  flag.position.set(0.3, 0, 2);
  for (const part of [post, flag]) part.castShadow = true;
  made.add(edge, disc, post, flag);
  if (many > 1) {
    const label = sign(String(index + 1), colours.good);
    label.position.z = 2.7;
    made.add(label);
  }
  made.position.set(x, y, 0);
  return made;
}

/** The heading that the bicycle is to have at a goal, flat on its disc. */
function arrow(radius, heading) {
  const long = Math.max(0.8, 0.8 * radius);
  const [wide, head] = [0.09 * long, 0.5 * long];
  const shape = new THREE.Shape([[-long, -wide], [long - head, -wide], [long - head, -0.34 * long], [long, 0], [long - head, 0.34 * long], [long - head, wide], [-long, wide]]
    .map(([x, y]) => new THREE.Vector2(x, y)));
  const made = new THREE.Mesh(new THREE.ShapeGeometry(shape), new THREE.MeshBasicMaterial({ color: colours.good, transparent: true, opacity: 0.8, side: THREE.DoubleSide }));
  made.name = "arrival";
  made.position.z = 0.018;
  made.rotation.z = heading;
  return made;
}

function signOf(kind, radius) {
  const flat = (geometry, colour, opacity = 0.7) => {
    const made = new THREE.Mesh(geometry, new THREE.MeshBasicMaterial({ color: colour, transparent: true, opacity, side: THREE.DoubleSide }));
    made.position.z = 0.013;
    return made;
  };
  if (kind === "reached") return flat(new THREE.RingGeometry(Math.max(0.05, radius - 0.05), radius, 48), colours.good, 0.35);
  if (kind === "push") return flat(new THREE.RingGeometry(0.16, 0.24, 24), colours.warn);
  if (kind === "hand_over") return flat(new THREE.RingGeometry(0.2, 0.3, 4), colours.warn);
  if (kind === "fell") {
    const made = new THREE.Group();
    for (const angle of [Math.PI / 4, -Math.PI / 4]) {
      const bar = flat(new THREE.PlaneGeometry(0.9, 0.1), colours.bad, 0.9);
      bar.rotation.z = angle;
      made.add(bar);
    }
    return made;
  }
  return null;
}
