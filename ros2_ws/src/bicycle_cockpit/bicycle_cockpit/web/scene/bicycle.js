// A bicycle with its rider, built from the geometry of the one that is ridden: wheelbase, trail, tilt of the steering
// axis, wheel radii, ratio of the crank. The origin is the rear contact, x is forward, y left, z up.

import * as THREE from "../vendor/three.module.min.js";
import { ball, joint, merged, ring, rods, stretch, tube, vector } from "./solids.js";

/** kg: a lighter one has no rider. */
const RIDERLESS = 35;
const CRANK = 0.17;
const SPOKES = 32;
const SPOKE = 0.0016;
const [THIGH, SHANK, UPPER_ARM, FOREARM] = [0.43, 0.45, 0.31, 0.29];
const GHOST = 0.32;

function materials(ghost) {
  const make = (color, roughness = 0.6, metalness = 0.1) => new THREE.MeshStandardMaterial({
    color, roughness, metalness, ...(ghost ? { transparent: true, opacity: GHOST, depthWrite: false } : {}),
  });
  return {
    frame: make("#b3261e", 0.35, 0.25), metal: make("#b9bec4", 0.3, 0.75), tyre: make("#1b1d20", 0.9, 0), rim: make("#3b4046", 0.4, 0.6),
    dark: make("#22262b", 0.8, 0), skin: make("#c98f6b", 0.8, 0), jersey: make("#2563a8", 0.85, 0), shorts: make("#2a2f36", 0.9, 0),
    shoe: make("#e8e8e4", 0.7, 0), helmet: make("#f2f2ee", 0.4, 0),
  };
}

function wheel(radius, paint, axle) {
  const tyre = 0.02;
  const parts = [ring(radius - tyre, tyre, paint.tyre, 10, 64), ring(radius - 2.1 * tyre, 0.011, paint.rim, 6, 64)];
  const spokes = [];
  for (let index = 0; index < SPOKES; index++) {
    const side = index % 2 ? 1 : -1;
    const angle = (2 * Math.PI * index) / SPOKES;
    // Spokes leave the hub at a tangent, two of them forward and two backward.
    const hub = angle + (index % 4 < 2 ? 1.1 : -1.1);
    spokes.push([vector(0.022 * Math.cos(hub), 0.03 * side, 0.022 * Math.sin(hub)),
      vector((radius - 2.2 * tyre) * Math.cos(angle), 0.004 * side, (radius - 2.2 * tyre) * Math.sin(angle))]);
  }
  parts.push(rods(spokes, SPOKE, paint.metal), tube(vector(0, -axle, 0), vector(0, axle, 0), 0.012, paint.metal));
  for (const side of [-1, 1]) parts.push(tube(vector(0, side * 0.028, 0), vector(0, side * 0.033, 0), 0.028, paint.metal));
  // A valve shows that the wheel turns.
  parts.push(tube(vector(0, 0, radius - 0.05), vector(0, 0, radius - 0.1), 0.004, paint.dark));
  return merged(parts);
}

export class Bicycle {
  /**
   * @param {object} geometry of the bicycle, as the cockpit tells it
   * @param {boolean} ghost whether it is drawn translucent
   */
  constructor(geometry, ghost = false) {
    this.size = geometry;
    this.paint = materials(ghost);
    this.group = new THREE.Group();
    this.leaning = new THREE.Group();
    this.group.add(this.leaning);
    this.turn = 0;
    this.crankTurn = 0;
    this.last = null;
    this.ridden = this.size.mass >= RIDERLESS;
    this.buildRear();
    this.buildFront();
    if (this.ridden) this.buildRider();
    if (ghost) this.group.traverse((part) => (part.castShadow = false));
  }

  buildRear() {
    const { size, paint, leaning } = this;
    const { rear_radius: r, front_radius: f, wheelbase: w } = size;
    const rear = vector(0, 0, r);
    const bracket = (this.bracket = vector(Math.min(0.44, 0.42 * w), 0, 0.82 * r));
    const seat = (this.seat = bracket.clone().add(vector(-0.2, 0, 0.66)));
    const post = bracket.clone().lerp(seat, 0.76);
    // The steering axis: through `foot` on the road, tilted back.
    this.foot = vector(w + size.trail, 0, 0);
    this.axis = vector(-Math.sin(size.steer_axis_tilt), 0, Math.cos(size.steer_axis_tilt));
    this.onAxis = (height) => this.foot.clone().addScaledVector(this.axis, height / this.axis.z);
    this.crown = 2 * f + 0.05;
    const [low, high] = [this.onAxis(this.crown + 0.02), this.onAxis(this.crown + 0.17)];
    const frame = [
      tube(bracket, seat.clone().add(vector(0.01, 0, -0.05)), 0.014, paint.metal),
      tube(bracket, post, 0.017, paint.frame), tube(bracket, low, 0.021, paint.frame), tube(post, high, 0.018, paint.frame),
      tube(low, high, 0.024, paint.frame),
      tube(bracket.clone().add(vector(0, -0.045, 0)), bracket.clone().add(vector(0, 0.045, 0)), 0.024, paint.frame),
    ];
    for (const side of [-0.055, 0.055]) {
      const end = rear.clone().add(vector(0, side, 0));
      frame.push(tube(end, bracket.clone().add(vector(-0.03, 0.5 * side, 0)), 0.009, paint.frame));
      frame.push(tube(end, post.clone().add(vector(0, 0.35 * side, -0.02)), 0.008, paint.frame));
    }
    const saddle = ball(seat, 0.075, paint.dark, [1, 0.95, 0.42]);
    saddle.position.x -= 0.05;
    frame.push(saddle, ball(seat.clone().add(vector(0.07, 0, 0)), 0.045, paint.dark, [2, 0.6, 0.6]));
    this.rear = wheel(r, paint, 0.06);
    this.rear.position.copy(rear);
    const chainring = ring(0.085, 0.006, paint.metal, 6, 40);
    chainring.position.y = -0.055;
    const crank = [chainring];
    for (const side of [-1, 1]) {
      const pedal = vector(-side * CRANK, side * 0.07, 0);
      crank.push(tube(vector(0, side * 0.06, 0), pedal, 0.011, paint.metal));
      for (let arm = 0; arm < 5 && side < 0; arm++) {
        const angle = (2 * Math.PI * arm) / 5;
        crank.push(tube(vector(0, -0.055, 0), vector(0.085 * Math.cos(angle), -0.055, 0.085 * Math.sin(angle)), 0.006, paint.metal));
      }
    }
    const cog = ring(0.085 * size.crank_ratio, 0.005, paint.metal, 6, 24);
    cog.position.copy(rear).setY(-0.055);
    frame.push(cog);
    for (const up of [-1, 1]) {
      frame.push(tube(rear.clone().add(vector(0, -0.055, up * 0.085 * size.crank_ratio)), bracket.clone().add(vector(0, -0.055, up * 0.085)), 0.004, paint.dark, 0.004, 6));
    }
    this.crank = merged(crank);
    this.crank.position.copy(bracket);
    leaning.add(this.rear, this.crank, merged(frame));
    this.pedals = [-1, 1].map((side) => {
      const pedal = new THREE.Mesh(new THREE.BoxGeometry(0.09, 0.085, 0.018), paint.dark);
      pedal.castShadow = true;
      leaning.add(pedal);
      return { side, mesh: pedal };
    });
  }

  buildFront() {
    const { size, paint } = this;
    const front = (this.steering = new THREE.Group());
    front.position.copy(this.foot);
    this.leaning.add(front);
    const local = (point) => point.clone().sub(this.foot);
    const crown = local(this.onAxis(this.crown));
    const top = local(this.onAxis(Math.max(this.crown + 0.2, this.seat.z + 0.06)));
    this.front = wheel(size.front_radius, paint, 0.05);
    this.front.position.set(-size.trail, 0, size.front_radius);
    const parts = [tube(crown, top, 0.015, paint.metal), tube(crown.clone().add(vector(0, -0.055, 0)), crown.clone().add(vector(0, 0.055, 0)), 0.018, paint.frame)];
    for (const side of [-0.052, 0.052]) {
      parts.push(tube(crown.clone().add(vector(0, side, 0)), this.front.position.clone().add(vector(0, side, 0)), 0.015, paint.frame, 0.009));
    }
    // Grips stay within the rider's reach, swept back where the axis stands far in front.
    const reach = Math.min(this.foot.x + top.x + 0.05, this.seat.x + 0.6);
    const grip = (side) => vector(reach - this.foot.x, 0.29 * side, top.z + 0.02);
    for (const side of [-1, 1]) {
      const bend = vector(top.x, 0.13 * side, top.z + 0.01);
      const inner = grip(side).add(vector(0.1, 0.01 * -side, 0));
      parts.push(tube(top, bend, 0.012, paint.metal), tube(bend, inner, 0.011, paint.metal), tube(inner, grip(side).add(vector(-0.03, 0, 0)), 0.016, paint.dark));
    }
    parts.push(ball(top, 0.018, paint.metal));
    this.grips = [-1, 1].map(grip);
    const lamp = ball(crown.clone().add(vector(0.05, 0, 0.06)), 0.03, paint.metal, [0.7, 1, 1]);
    parts.push(lamp);
    front.add(this.front, merged(parts));
  }

  buildRider() {
    const { paint } = this;
    const limb = (radius, material, end = radius) => tube(vector(0, 0, 0), vector(0, 1, 0), radius, material, end, 14);
    this.body = {
      torso: limb(0.125, paint.jersey, 0.155), hips: ball(vector(0, 0, 0), 0.135, paint.shorts, [1, 1.25, 0.85]),
      chest: ball(vector(0, 0, 0), 0.15, paint.jersey, [0.8, 1.3, 0.75]), neck: limb(0.05, paint.skin), head: ball(vector(0, 0, 0), 0.1, paint.skin, [1.05, 0.85, 1.2]),
      helmet: ball(vector(0, 0, 0), 0.117, paint.helmet, [1.2, 0.9, 0.85]),
      limbs: [-1, 1].map((side) => ({
        side, thigh: limb(0.085, paint.shorts, 0.062), knee: ball(vector(0, 0, 0), 0.06, paint.skin), shank: limb(0.056, paint.skin, 0.04),
        shoe: ball(vector(0, 0, 0), 0.05, paint.shoe, [2.3, 0.85, 0.75]), shoulder: ball(vector(0, 0, 0), 0.065, paint.jersey),
        upper: limb(0.052, paint.jersey, 0.043), elbow: ball(vector(0, 0, 0), 0.042, paint.skin), fore: limb(0.042, paint.skin, 0.032), hand: ball(vector(0, 0, 0), 0.042, paint.skin),
      })),
    };
    const { limbs, ...rest } = this.body;
    this.rider = new THREE.Group();
    this.rider.name = "rider";
    this.rider.add(...Object.values(rest));
    for (const { side, ...parts } of limbs) this.rider.add(...Object.values(parts));
    // The torso is flat from front to back.
    this.leaning.add(this.rider);
  }

  /** The colour of the rider's jersey: that of the policy that rides. */
  dress(colour) {
    this.paint.jersey.color.set(colour);
  }

  /** The colour of a whole ghost. */
  tint(colour) {
    for (const material of Object.values(this.paint)) material.color.lerp(new THREE.Color(colour), 0.55);
  }

  /**
   * @param row where it is: x, y, heading, lean (right), steer (left), displacement (left), as in the messages
   */
  pose(row) {
    const known = (value) => (Number.isFinite(value) ? value : 0);
    this.group.position.set(known(row.x), known(row.y), 0);
    this.group.rotation.z = known(row.heading);
    this.leaning.rotation.x = known(row.lean);
    this.steering.quaternion.setFromAxisAngle(this.axis, known(row.steer));
    this.roll(row);
    this.rear.rotation.y = this.turn;
    this.front.rotation.y = (this.turn * this.size.rear_radius) / this.size.front_radius;
    this.crankTurn = this.turn * this.size.crank_ratio;
    this.crank.rotation.y = this.crankTurn;
    for (const { side, mesh } of this.pedals) mesh.position.copy(this.pedal(side));
    if (this.ridden) this.poseRider(known(row.displacement));
    this.leaning.updateMatrixWorld();
  }

  /** The wheels turn by the way that was ridden since the last picture. */
  roll({ x, y, heading }) {
    const { last } = this;
    if (last && Number.isFinite(x)) {
      const way = (x - last.x) * Math.cos(heading) + (y - last.y) * Math.sin(heading);
      if (Math.abs(way) < 5) this.turn += way / this.size.rear_radius;
    }
    this.last = { x, y };
  }

  pedal(side) {
    const angle = this.crankTurn;
    return vector(-side * CRANK * Math.cos(angle), side * 0.115, side * CRANK * Math.sin(angle)).add(this.bracket);
  }

  poseRider(shift) {
    const { torso, hips, chest, neck, head, helmet, limbs } = this.body;
    // The middle of the body goes by the displacement; hips stay nearer to the saddle, the head goes farther.
    const hip = this.seat.clone().add(vector(-0.02, 0.55 * shift, 0.09));
    const top = hip.clone().add(vector(0.3, 0.75 * shift, 0.4));
    stretch(torso, hip, top);
    hips.position.copy(hip);
    chest.position.copy(top);
    const skull = top.clone().add(vector(0.13, 0.15 * shift, 0.24));
    stretch(neck, top.clone().add(vector(0.03, 0, 0.06)), skull);
    head.position.copy(skull);
    helmet.position.copy(skull).add(vector(-0.01, 0, 0.055));
    for (const limb of limbs) {
      const { side } = limb;
      const start = hip.clone().add(vector(0.02, 0.09 * side, -0.01));
      const pedal = this.pedal(side);
      const ankle = pedal.clone().add(vector(-0.07, -0.02 * side, 0.1));
      const knee = joint(start, ankle, THIGH, SHANK, vector(1, 0.25 * side, 0.2));
      stretch(limb.thigh, start, knee);
      limb.knee.position.copy(knee);
      stretch(limb.shank, knee, ankle);
      limb.shoe.position.copy(pedal).add(vector(0, -0.01 * side, 0.045));
      const shoulder = top.clone().add(vector(0.02, 0.19 * side, 0.02));
      const hand = this.grips[side < 0 ? 0 : 1].clone().applyQuaternion(this.steering.quaternion).add(this.foot).add(vector(0, 0, 0.02));
      const elbow = joint(shoulder, hand, UPPER_ARM, FOREARM, vector(-0.2, 0.8 * side, -0.6));
      limb.shoulder.position.copy(shoulder);
      stretch(limb.upper, shoulder, elbow);
      limb.elbow.position.copy(elbow);
      stretch(limb.fore, elbow, hand);
      limb.hand.position.copy(hand);
    }
  }

  /** Frees what the graphics card holds. */
  dispose() {
    this.group.removeFromParent();
    this.group.traverse((part) => part.geometry?.dispose());
    for (const material of Object.values(this.paint)) material.dispose();
  }
}
