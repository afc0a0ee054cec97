// Where the scene is looked at from: behind the bicycle, around it, from the side, with the rider's eyes, from above.

import * as THREE from "../vendor/three.module.min.js";

export const CAMERAS = ["chase", "orbit", "side", "rider", "top"];
const EASE = { chase: 3.5, side: 5, rider: 14, top: 5, orbit: 1e9 };

export class Eye {
  constructor() {
    this.camera = new THREE.PerspectiveCamera(46, 1, 0.1, 400);
    this.camera.up.set(0, 0, 1);
    this.mode = "chase";
    this.distance = 1;
    this.azimuth = -2.3;
    this.elevation = 0.32;
    this.heading = null;
    this.place = new THREE.Vector3();
    this.aim = new THREE.Vector3();
    this.fresh = true;
  }

  choose(mode) {
    this.mode = mode;
    this.fresh = true;
  }

  zoom(factor) {
    this.distance = Math.min(8, Math.max(0.4, this.distance / factor));
  }

  /** Turns around the bicycle by an angle; from any other camera this becomes the orbit. */
  turn(sideways, upwards) {
    if (this.mode !== "orbit") {
      const away = this.place.clone().sub(this.aim);
      this.azimuth = Math.atan2(away.y, away.x);
      this.elevation = Math.atan2(away.z, Math.hypot(away.x, away.y));
      this.distance = Math.min(8, Math.max(0.4, away.length() / 4.2));
      this.choose("orbit");
    }
    this.azimuth -= sideways;
    this.elevation = Math.min(1.5, Math.max(0.03, this.elevation + upwards));
  }

  /**
   * @param row where the bicycle is @param length its wheelbase @param elapsed s since the last picture
   */
  look(row, length, elapsed) {
    const { mode, distance: d } = this;
    const heading = this.eased(row.heading, elapsed);
    const ahead = new THREE.Vector3(Math.cos(heading), Math.sin(heading), 0);
    const left = new THREE.Vector3(-ahead.y, ahead.x, 0);
    const middle = new THREE.Vector3(row.x, row.y, 0).addScaledVector(new THREE.Vector3(Math.cos(row.heading), Math.sin(row.heading), 0), length / 2);
    const place = middle.clone();
    const aim = middle.clone().setZ(0.85);
    this.camera.up.set(0, 0, 1);
    if (mode === "chase") {
      place.addScaledVector(ahead, -3.6 * d).addScaledVector(left, 0.9 * d).setZ(0.9 + 0.95 * d);
      aim.addScaledVector(ahead, 1.1);
    } else if (mode === "side") place.addScaledVector(left, -4 * d).setZ(1.05);
    else if (mode === "rider") {
      const eye = new THREE.Vector3(0, 0.35 * (row.displacement || 0), 1.72).applyAxisAngle(new THREE.Vector3(1, 0, 0), row.lean || 0);
      place.set(row.x, row.y, 0).addScaledVector(ahead, 0.62).addScaledVector(left, eye.y).setZ(eye.z);
      aim.copy(place).addScaledVector(ahead, 6).setZ(0.6);
      this.camera.up.set(0, 0, 1).applyAxisAngle(ahead, row.lean || 0);
    } else if (mode === "top") {
      place.setZ(9 * d);
      aim.setZ(0);
      this.camera.up.set(0, 1, 0);
    } else {
      const flat = 4.2 * d * Math.cos(this.elevation);
      place.add(new THREE.Vector3(flat * Math.cos(this.azimuth), flat * Math.sin(this.azimuth), 0)).setZ(0.85 + 4.2 * d * Math.sin(this.elevation));
    }
    this.place.copy(place);
    this.aim.copy(aim);
    this.camera.position.copy(this.place);
    this.camera.lookAt(this.aim);
    this.fresh = false;
  }

  /** The heading, followed softly, so that a chase looks like one. */
  eased(heading, elapsed) {
    if (this.fresh || this.heading === null || !Number.isFinite(this.heading)) this.heading = heading;
    const off = Math.atan2(Math.sin(heading - this.heading), Math.cos(heading - this.heading));
    this.heading += off * Math.min(1, elapsed * (EASE[this.mode] ?? 5));
    return this.heading;
  }
}
