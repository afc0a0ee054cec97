// Equations 1-13 of the paper's bicycle, compiled: the bits of dynamics.py, whose names these are.
#pragma once

#include <cmath>

#include "../compiled.h"

namespace choi {

struct Numbers {  // compiled.py prepares them
  double time_step, pedal, mass_height, tyre_radius, tyre_spin, wheelbase, mass_offset, tyres;
  double turning, gravity, lean_inertia, coupling, steer_inertia, steer_stop, drift;
  int64_t chord_follows_steering, stop_absorbs_steering;
};

namespace {

struct Step : Block {  // `make` fills `next`
  using Numbers = choi::Numbers;
  static constexpr const char* NAME = "choi";

  const Numbers& k;
  Row front, rear, mass, tilt, ahead, behind;
  Row& speed = next[SPEED];

  Step(const Numbers& numbers, const Loops& loops, const SpeedLimits& limits, const double* state, long all, long n)
      : Block(loops, limits, state, all, n), k(numbers) {}

  WIDEST void accelerate() {  // equations 11 to 13
    const double* before = old(SPEED);
    for (long i = 0; i < n; i++) {
      const double faster = before[i] + k.time_step * (pedal.at[i] * k.pedal);
      speed.at[i] = limits.given ? clipped(faster, limits.low, limits.high) : faster;
      q.at[i] = displacement.at[i] / k.mass_height;
    }
  }

  WIDEST void curvatures() {  // equations 3 and 4; p and q hold the steering's sine and cosine
    const double* lean = old(LEAN);
    for (long i = 0; i < n; i++) {
      const double sine = std::fabs(p.at[i]);
      front.at[i] = sine / k.wheelbase;
      rear.at[i] = sine / (k.wheelbase * q.at[i]);
      const double offset = k.mass_offset * rear.at[i];
      mass.at[i] = rear.at[i] / std::sqrt(1.0 + offset * offset);
      tilt.at[i] = lean[i] + tilt.at[i];  // equation 6
    }
  }

  WIDEST void turn() {  // equations 5 and 7; p and q hold the tilt's sine and cosine
    const double *lean = old(LEAN), *lean_rate = old(LEAN_RATE), *steer = old(STEER), *steer_rate = old(STEER_RATE);
    const double* heading = old(HEADING);
    for (long i = 0; i < n; i++) {
      const double wheel_rate = speed.at[i] / k.tyre_radius;
      const double turning = k.tyres * (front.at[i] + rear.at[i]) + k.turning * mass.at[i];
      const double centrifugal = sign(steer[i]) * speed.at[i] * speed.at[i] * turning;
      const double gyroscopic = k.tyre_spin * wheel_rate * steer_rate[i];
      const double acceleration = (k.gravity * p.at[i] - q.at[i] * (gyroscopic + centrifugal)) / k.lean_inertia;
      const double steering = (torque.at[i] + k.coupling * wheel_rate * lean_rate[i]) / k.steer_inertia;
      next[LEAN_ACCELERATION].at[i] = acceleration;
      next[LEAN_RATE].at[i] = lean_rate[i] + acceleration * k.time_step;
      next[LEAN].at[i] = lean[i] + next[LEAN_RATE].at[i] * k.time_step;
      const double rate = steer_rate[i] + steering * k.time_step;
      const double free_angle = steer[i] + rate * k.time_step;
      const double angle = clipped(free_angle, -k.steer_stop, k.steer_stop);
      next[STEER].at[i] = angle;
      next[STEER_RATE].at[i] = k.stop_absorbs_steering && free_angle != angle ? 0.0 : rate;
      const double half = 0.5 * (speed.at[i] * k.time_step);
      r.at[i] = clipped(half * front.at[i], -1.0, 1.0);
      s.at[i] = clipped(half * rear.at[i], -1.0, 1.0);
      ahead.at[i] = heading[i] + angle;
    }
  }

  WIDEST void point() {  // the chords' directions; p and q hold their half angles
    const double* heading = old(HEADING);
    for (long i = 0; i < n; i++) {
      const double pointing = ahead.at[i], steer = next[STEER].at[i];
      const double front_side = sign(k.chord_follows_steering ? steer : pointing);
      const double rear_side = sign(k.chord_follows_steering ? steer : heading[i]);
      ahead.at[i] = pointing + front_side * p.at[i];
      behind.at[i] = heading[i] + rear_side * q.at[i];
    }
  }

  WIDEST void roll() {  // equations 1 and 2; p, q, r, s: sine and cosine ahead and behind
    const double *front_x = old(FRONT_X), *front_y = old(FRONT_Y), *rear_x = old(REAR_X), *rear_y = old(REAR_Y);
    for (long i = 0; i < n; i++) {
      const double travel = speed.at[i] * k.time_step;
      const double fx = front_x[i] - travel * p.at[i], fy = front_y[i] + travel * q.at[i];
      const double rx = rear_x[i] - travel * r.at[i], ry = rear_y[i] + travel * s.at[i];
      const double along_x = rx - fx, along_y = ry - fy;
      const double distance = std::sqrt(along_x * along_x + along_y * along_y);
      const double drifted = (k.wheelbase - distance) / distance;
      const double stretch = std::fabs(distance - k.wheelbase) > k.drift ? drifted : 0.0;
      next[FRONT_X].at[i] = fx;
      next[FRONT_Y].at[i] = fy;
      next[REAR_X].at[i] = rx + along_x * stretch;
      next[REAR_Y].at[i] = ry + along_y * stretch;
      p.at[i] = next[REAR_X].at[i] - fx;
      q.at[i] = fy - next[REAR_Y].at[i];
    }
  }

  void make() {
    accelerate();
    one(loops.arctan, q.at, tilt, n);
    one(loops.sin, old(STEER), p, n);
    one(loops.cos, old(STEER), q, n);
    curvatures();
    one(loops.sin, tilt.at, p, n);
    one(loops.cos, tilt.at, q, n);
    turn();
    one(loops.arcsin, r.at, p, n);
    one(loops.arcsin, s.at, q, n);
    point();
    one(loops.sin, ahead.at, p, n);
    one(loops.cos, ahead.at, q, n);
    one(loops.sin, behind.at, r, n);
    one(loops.cos, behind.at, s, n);
    roll();
    two(loops.arctan2, p.at, 8, q.at, 8, next[HEADING].at, n);
  }
};

}  // namespace

}  // namespace choi
