// The 3D picture: renderer, its quality, and what a picture holds.

import * as THREE from "../vendor/three.module.min.js";
import { Bicycle } from "./bicycle.js";
import { Eye } from "./cameras.js";
import { World } from "./world.js";

/** Pictures a second of a renderer without a graphics card, which shares its processor with the ride. */
const SOFT = 12;
const SLOW = 26;
const PATIENCE = 40;
/** ms. */
const LONGEST_REST = 500;

const SOFTWARE = /swiftshader|llvmpipe|software|basic render/i;

/** The name of what draws, or nothing where the browser keeps it to itself. */
function cardName() {
  const context = document.createElement("canvas").getContext("webgl2");
  if (!context) throw new Error("no WebGL 2");
  const info = context.getExtension("WEBGL_debug_renderer_info");
  const name = info ? context.getParameter(info.UNMASKED_RENDERER_WEBGL) : "";
  context.getExtension("WEBGL_lose_context")?.loseContext();
  return name;
}

export class Stage {
  /**
   * @param {HTMLCanvasElement} canvas
   * @param {string} quality `high`, `low`, or empty: by what draws
   * @throws where the browser has no WebGL 2
   */
  constructor(canvas, quality = "") {
    this.canvas = canvas;
    this.card = cardName();
    this.soft = SOFTWARE.test(this.card);
    this.fixed = quality !== "";
    this.level = quality === "low" || (!quality && this.soft) ? 0 : 2;
    this.renderer = new THREE.WebGLRenderer({ canvas, antialias: this.level > 0, preserveDrawingBuffer: quality === "film", powerPreference: "high-performance" });
    // Waiting for each shader's errors would let none be compiled beside another.
    this.renderer.debug.checkShaderErrors = false;
    this.renderer.outputColorSpace = THREE.SRGBColorSpace;
    this.renderer.shadowMap.type = THREE.PCFSoftShadowMap;
    this.world = new World();
    this.eye = new Eye();
    this.bicycle = null;
    /** Translucent bicycles beside it: a `ghost` of another ride, and where the `estimate` takes it to be. */
    this.others = {};
    this.built = this.dressed = "";
    this.last = this.width = this.height = this.slow = 0;
    this.lost = false;
    this.pending = null;
    this.rest = 0;
    canvas.addEventListener("webglcontextlost", (event) => {
      event.preventDefault();
      this.lost = true;
      this.pending = null;
    });
    canvas.addEventListener("webglcontextrestored", () => (this.lost = false));
    this.setLevel(this.level);
  }

  /** ms between two pictures. */
  get pace() {
    return this.soft && !this.fixed ? 1000 / SOFT : 0;
  }

  /**
   * Whether another picture may be asked for. A processor that draws must not get more than it can do, or the page
   * answers no click: the picture before is to be finished, and as much time again is left to all else.
   */
  ready(now) {
    if (!this.pending) return now >= this.rest;
    const context = this.renderer.getContext();
    if (context.getSyncParameter(this.pending, context.SYNC_STATUS) !== context.SIGNALED) return false;
    context.deleteSync(this.pending);
    this.pending = null;
    this.rest = now + Math.min(now - this.last, LONGEST_REST);
    return false;
  }

  setLevel(level) {
    this.level = level;
    this.renderer.shadowMap.enabled = level > 0;
    this.world.sun.castShadow = level > 0;
    this.world.sharpen(level > 0);
    this.ratio = level > 1 ? Math.min(window.devicePixelRatio || 1, 2) : Math.min(1, window.devicePixelRatio || 1);
    this.width = 0;
    this.world.scene.traverse((part) => part.material && (part.material.needsUpdate = true));
  }

  /** Lowers the quality where pictures take too long. */
  watch(elapsed) {
    if (this.fixed || this.soft || this.level === 0) return;
    this.slow = Math.max(0, this.slow + (elapsed > SLOW && elapsed < 400 ? 1 : -0.5));
    if (this.slow > PATIENCE) {
      this.slow = 0;
      this.setLevel(this.level - 1);
    }
  }

  sized() {
    const { clientWidth: width, clientHeight: height } = this.canvas;
    if (width === this.width && height === this.height) return width > 0 && height > 0;
    [this.width, this.height] = [width, height];
    if (!width || !height) return false;
    this.renderer.setPixelRatio(this.ratio);
    this.renderer.setSize(width, height, false);
    this.eye.camera.aspect = width / height;
    this.eye.camera.fov = width < height ? 58 : 46;
    this.eye.camera.updateProjectionMatrix();
    return true;
  }

  themed() {
    this.world.themed();
  }

  build(geometry) {
    const wanted = JSON.stringify(geometry);
    if (wanted === this.built && this.bicycle) return;
    this.built = wanted;
    this.bicycle?.dispose();
    this.bicycle = new Bicycle(geometry);
    this.dressed = "";
    this.world.scene.add(this.bicycle.group);
    for (const name of Object.keys(this.others)) this.drop(name);
  }

  drop(name) {
    this.others[name]?.bicycle.dispose();
    delete this.others[name];
  }

  /**
   * @param shown `row` (where the bicycle is), `geometry`, `series`, `cursor`, `paint`, `goal`, `ahead`, `radius`,
   *   `marks`, `pointed` (row or null), `path` (points that are followed), `jersey` (colour), `ghost` (null, or `row`, `series`, `cursor`, `colour`), `estimate` (the same)
   * @param {number} now ms
   */
  draw(shown, now) {
    if (this.lost || !shown.geometry || !this.sized()) return; // the cockpit tells it first of all
    const elapsed = Math.min(0.25, Math.max(0, (now - this.last) / 1000));
    this.watch(now - this.last);
    this.last = now;
    this.build(shown.geometry);
    const { world, bicycle, eye } = this;
    const row = shown.row ?? { x: 0, y: 0, heading: 0, lean: 0, steer: 0, displacement: 0 };
    if (shown.jersey !== this.dressed) bicycle.dress((this.dressed = shown.jersey));
    bicycle.pose(row);
    world.centre(row.x, row.y);
    const points = [...(shown.goal ? [shown.goal] : []), ...shown.ahead];
    world.aim(points, shown.radius, shown.row ? [row.x, row.y] : null, Boolean(shown.goal));
    world.mark(shown.marks, shown.radius);
    world.point(shown.pointed);
    world.follow(shown.path);
    world.track(world.trail, shown.series, shown.row ? shown.cursor : -1, shown.paint, row);
    this.drawOther("ghost", shown.ghost, shown.geometry, world.other);
    this.drawOther("estimate", shown.estimate, shown.geometry, world.estimated);
    eye.look(row, bicycle.size.wheelbase, elapsed);
    if (bicycle.rider) bicycle.rider.visible = eye.mode !== "rider";
    this.renderer.render(world.scene, eye.camera);
    if (!this.soft || this.fixed) return;
    const context = this.renderer.getContext();
    if (this.pending) context.deleteSync(this.pending);
    this.pending = context.fenceSync(context.SYNC_GPU_COMMANDS_COMPLETE, 0);
    context.flush();
  }

  drawOther(name, shown, geometry, band) {
    band.mesh.visible = Boolean(shown?.row);
    const there = this.others[name];
    if (!shown?.row) {
      if (there) there.bicycle.group.visible = false;
      return;
    }
    if (there && there.series !== shown.series) this.drop(name);
    if (!this.others[name]) {
      const bicycle = new Bicycle(shown.geometry ?? geometry, true);
      bicycle.tint(shown.colour);
      this.world.scene.add(bicycle.group);
      this.others[name] = { bicycle, series: shown.series };
    }
    const { bicycle } = this.others[name];
    bicycle.group.visible = true;
    bicycle.pose(shown.row);
    this.world.track(band, shown.series, shown.cursor, () => shown.colour, shown.row);
  }

  /** What a point of the picture shows: `rider`, and the place on the ground, or null. */
  hit(px, py) {
    const at = new THREE.Vector2((2 * px) / this.width - 1, 1 - (2 * py) / this.height);
    const ray = new THREE.Raycaster();
    ray.setFromCamera(at, this.eye.camera);
    const rider = this.bicycle ? ray.intersectObject(this.bicycle.group, true).length > 0 : false;
    const place = ray.ray.intersectPlane(new THREE.Plane(new THREE.Vector3(0, 0, 1), 0), new THREE.Vector3());
    const far = place ? place.distanceTo(this.eye.camera.position) : Infinity;
    return { rider, place: place && far < 250 ? [place.x, place.y] : null };
  }

  /** Where on the picture the rider's chest is, CSS pixels. */
  whereRider() {
    const at = this.bicycle.body.chest.getWorldPosition(new THREE.Vector3()).project(this.eye.camera);
    return [((at.x + 1) / 2) * this.width, ((1 - at.y) / 2) * this.height];
  }

  /** Which way on the picture is to the bicycle's right: 1 or -1. */
  get rightward() {
    const heading = this.bicycle?.group.rotation.z ?? 0;
    const right = new THREE.Vector3(Math.sin(heading), -Math.cos(heading), 0);
    const across = new THREE.Vector3().setFromMatrixColumn(this.eye.camera.matrixWorld, 0);
    return right.dot(across) >= 0 ? 1 : -1;
  }
}
