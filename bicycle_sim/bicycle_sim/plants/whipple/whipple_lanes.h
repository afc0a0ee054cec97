// kinematics.py, equations.py, leaning_rider.py and integrate.py for LANES bicycles at once, each in one lane of a vector.
//
// whipple.cpp includes this once for each kind of vector instructions, in a namespace of its own
// that defines LANES. Every function has the operations of its namesake in Python, in the same
// order, so that all of them give the same bits.

typedef double D __attribute__((vector_size(LANES * sizeof(double))));
typedef long long Mask __attribute__((vector_size(LANES * sizeof(double))));

#define MEMBER(name) D name;
struct Constants { CONSTANTS(MEMBER) };
struct State { STATES(MEMBER) };
struct Inputs { INPUTS(MEMBER) };
#undef MEMBER

// Their members by number.
ALWAYS D* rows(Constants& k) { return &k.gravity; }
ALWAYS D* rows(State& s) { return &s.lean_angle; }
ALWAYS D* rows(Inputs& u) { return &u.torque_before; }

ALWAYS D all(double value) { return value - D{}; }

ALWAYS D size(D value) {
  const Mask mask = (Mask)value & 0x7fffffffffffffffLL;
  return (D)mask;
}

ALWAYS D root(D value) {
  D found;
  for (int l = 0; l < LANES; ++l) found[l] = std::sqrt(value[l]);
  return found;
}

struct Vector { D x, y, z; };

ALWAYS Vector cross(Vector a, Vector b) {
  return {a.y * b.z - a.z * b.y, a.z * b.x - a.x * b.z, a.x * b.y - a.y * b.x};
}

ALWAYS Vector cross_plane(Vector a, D x, D z) {
  return {a.y * z, a.z * x - a.x * z, -(a.y * x)};
}

ALWAYS Vector about_z(Vector a, D sine, D cosine) {
  return {cosine * a.x + sine * a.y, cosine * a.y - sine * a.x, a.z};
}

ALWAYS Vector about_y(Vector a, D sine, D cosine) {
  return {cosine * a.x - sine * a.z, a.y, sine * a.x + cosine * a.z};
}

ALWAYS D bounded(D value, D low, D high) {
  value = value < low ? low : value;
  return value > high ? high : value;
}

ALWAYS D bounded(D value, double low, double high) { return bounded(value, all(low), all(high)); }

#include "sine.h"

// kinematics.py and equations.py

struct Forces {
  D steer_torque, rim_force, road_forward, road_across;
  Vector force, torque;
  D rear_rolling, front_rolling, rider_torque;
};

struct Rates { D ahead, lean, pitch, turn; };

struct Rolling {
  D s1, s2, s3, c1, c2, c3, across, steep, flat, sp, cp;
  Vector to_front;
  Rates per_yaw, per_pitch;
  D yaw_lever, pitch_lever, pitch_slip, yaw_inverse, pitch_inverse;
  D yaw[3], pitch[2];
  Rates front[3];
};

ALWAYS Rolling rolling(const Constants& k, D lean, D pitch, D steer) {
  Rolling r;
  sine_cosine(lean, r.s1, r.c1);
  sine_cosine(k.tilt + pitch, r.s2, r.c2);
  sine_cosine(steer, r.s3, r.c3);
  const D s1 = r.s1, c1 = r.c1, s2 = r.s2, c2 = r.c2, s3 = r.s3, c3 = r.c3;
  const Vector down = about_z({-(c1 * s2), s1, c1 * c2}, s3, c3);
  const Vector forward = {c3 * c2, -(s3 * c2), s2};
  const D steep = root(down.x * down.x + down.z * down.z);
  const D flat = 1.0 / steep;
  const D sp = -(down.x * flat), cp = down.z * flat;
  const Vector to_front = {k.axis_forward * c3 + k.fork_offset, -(k.axis_forward * s3),
                           k.axis_down};

  const D back = -(k.rear_radius * s1);
  Vector swept = cross(down, to_front);
  const Vector by_yaw = {back * forward.x + swept.x, back * forward.y + swept.y,
                         back * forward.z + swept.z};
  swept = cross(forward, to_front);
  const Vector by_lean = {k.rear_radius * s3 + swept.x, k.rear_radius * c3 + swept.y, swept.z};
  const Vector by_pitch = {c3 * k.axis_down, -(s3 * k.axis_down),
                           s3 * to_front.y - c3 * to_front.x};
#define ALONG(a) (cp * a.x + sp * a.z)
#define INTO(a) (cp * a.z - sp * a.x)
  const D heading = ALONG(forward);
  const D zero = all(0.0);
  const Rates per_yaw = {ALONG(by_yaw), zero, down.y, steep};
  const Rates per_lean = {ALONG(by_lean), heading, forward.y, INTO(forward)};
  const Rates per_pitch = {ALONG(by_pitch), cp * s3, c3, -(sp * s3)};

  const D lean_slip = by_lean.y - k.front_radius * per_lean.lean;
  const D pitch_slip = by_pitch.y - k.front_radius * per_pitch.lean;
  const D steer_slip = k.fork_offset - k.front_radius * sp;
  const D lean_sinks = down.y * lean_slip + steep * INTO(by_lean);
  const D pitch_sinks = down.y * pitch_slip + steep * INTO(by_pitch);
  const D steer_sinks = down.y * steer_slip;
  r.yaw_inverse = 1.0 / by_yaw.y;
  r.pitch_inverse = 1.0 / pitch_sinks;
  r.pitch[0] = -(lean_sinks * r.pitch_inverse);
  r.pitch[1] = -(steer_sinks * r.pitch_inverse);
  r.yaw[0] = -((lean_slip + pitch_slip * r.pitch[0]) * r.yaw_inverse);
  r.yaw[1] = -((steer_slip + pitch_slip * r.pitch[1]) * r.yaw_inverse);
  r.yaw[2] = -(forward.y * r.yaw_inverse);

  r.across = down.y;
  r.steep = steep;
  r.flat = flat;
  r.sp = sp;
  r.cp = cp;
  r.to_front = to_front;
  r.per_yaw = per_yaw;
  r.per_pitch = per_pitch;
  r.yaw_lever = by_yaw.y;
  r.pitch_lever = pitch_sinks;
  r.pitch_slip = pitch_slip;
  const D yaw0 = r.yaw[0], yaw1 = r.yaw[1], pitch0 = r.pitch[0], pitch1 = r.pitch[1];
  r.front[0] = {per_lean.ahead + (yaw0 * per_yaw.ahead + pitch0 * per_pitch.ahead),
                per_lean.lean + pitch0 * per_pitch.lean,
                per_lean.pitch + (yaw0 * per_yaw.pitch + pitch0 * per_pitch.pitch),
                per_lean.turn + (yaw0 * per_yaw.turn + pitch0 * per_pitch.turn)};
  r.front[1] = {0.0 + (yaw1 * per_yaw.ahead + pitch1 * per_pitch.ahead),
                sp + pitch1 * per_pitch.lean,
                0.0 + (yaw1 * per_yaw.pitch + pitch1 * per_pitch.pitch),
                cp + (yaw1 * per_yaw.turn + pitch1 * per_pitch.turn)};
  r.front[2] = {heading + r.yaw[2] * per_yaw.ahead, zero, r.yaw[2] * per_yaw.pitch,
                r.yaw[2] * per_yaw.turn};
  return r;
}

ALWAYS void front_contact(const Constants& k, const Rolling& r, D& forward, D& across) {
  const D x = r.to_front.x - k.front_radius * r.sp;
  const D z = r.to_front.z + k.front_radius * r.cp;
  const D bx = r.c3 * x - r.s3 * r.to_front.y, by = r.s3 * x + r.c3 * r.to_front.y;
  forward = r.c2 * bx + r.s2 * z;
  const D below = r.c2 * z - r.s2 * bx - k.rear_radius;
  across = r.c1 * by - r.s1 * below;
}

struct Motion { D yaw_rate, pitch_rate, front_spin, lean, steer, speed, rider, give[4]; };

struct Frame { D mass, radius, rotor, x, z, xx, yy, zz, xz; };

ALWAYS Frame frame(D mass, D radius, D rotor, D x, D z, D xx, D yy, D zz, D xz, D sine, D cosine) {
  const D tilt = sine * (zz - xx) + cosine * (2.0 * xz);
  const D along = xx + sine * tilt;
  return {mass, radius, rotor, cosine * x + sine * z, cosine * z - sine * x,
          along, yy, (xx + zz) - along, cosine * tilt - xz};
}

struct Change { Vector up, base; D ahead; };

struct Load { D ahead, lean, pitch, turn; };

ALWAYS Load load_of(const Frame& f, const Rates& w, const Change& change, Vector gravity) {
  const D bx = gravity.x - change.base.x, by = gravity.y - change.base.y;
  const D bz = gravity.z - change.base.z;
  const D ux = w.pitch * f.z, uy = w.turn * f.x - w.lean * f.z, uz = -(w.pitch * f.x);
  const D ax = change.up.x, ay = change.up.y, az = change.up.z;
  const D force_x = f.mass * bx - ay * f.z - (w.pitch * uz - w.turn * uy);
  const D force_y = f.mass * by - (az * f.x - ax * f.z) - (w.turn * ux - w.lean * uz);
  const D hx = f.xx * w.lean + f.xz * w.turn;
  const D hy = f.yy * w.pitch - (f.rotor * f.radius) * w.ahead;
  const D hz = f.xz * w.lean + f.zz * w.turn;
  const D torque_x = -(f.z * by) - (f.xx * ax + f.xz * az) - (w.pitch * hz - w.turn * hy);
  const D torque_y = (f.z * bx - f.x * bz) - f.yy * ay - (w.turn * hx - w.lean * hz);
  const D torque_z = f.x * by - (f.xz * ax + f.zz * az) - (w.lean * hy - w.pitch * hx);
  return {force_x - f.rotor * change.ahead, f.radius * force_y + torque_x, torque_y, torque_z};
}

// Projections on partial rates that lean the wheel's plane, and on those that do not.
ALWAYS D upright(const Rates& own, const Load& load) {
  return own.ahead * load.ahead + own.pitch * load.pitch + own.turn * load.turn;
}

ALWAYS D leaning(const Rates& own, const Load& load) {
  return upright(own, load) + own.lean * load.lean;
}

ALWAYS Load upright_momenta(const Frame& f, const Rates& own) {
  const D across = f.xz + f.radius * f.x;
  return {(f.mass + f.rotor) * own.ahead + f.z * own.pitch, across * own.turn,
          f.z * own.ahead + f.yy * own.pitch, f.zz * own.turn};
}

ALWAYS Load leaning_momenta(const Frame& f, const Rates& own) {
  const D across = f.xz + f.radius * f.x;
  const D heavy = f.xx + f.radius * (f.radius * f.mass - 2.0 * f.z);
  return {(f.mass + f.rotor) * own.ahead + f.z * own.pitch, heavy * own.lean + across * own.turn,
          f.z * own.ahead + f.yy * own.pitch, across * own.lean + f.zz * own.turn};
}

ALWAYS void add_rear_mass(const Frame& f, const Rates* own, D* mass) {
  const D across = f.xz + f.radius * f.x;
  const D heavy = f.xx + f.radius * (f.radius * f.mass - 2.0 * f.z);
  Load lean = upright_momenta(f, own[0]);
  lean.lean = lean.lean + heavy;
  lean.turn = lean.turn + across;
  const Load steer = upright_momenta(f, own[1]), speed = upright_momenta(f, own[2]);
  mass[0] = upright(own[0], lean) + lean.lean;
  mass[1] = upright(own[1], lean);
  mass[2] = upright(own[2], lean);
  mass[3] = upright(own[1], steer);
  mass[4] = upright(own[2], steer);
  mass[5] = upright(own[2], speed);
}

ALWAYS void add_front_mass(const Frame& f, const Rates* own, D* mass) {
  const Load lean = leaning_momenta(f, own[0]), steer = leaning_momenta(f, own[1]);
  const Load speed = upright_momenta(f, own[2]);
  mass[0] = mass[0] + leaning(own[0], lean);
  mass[1] = mass[1] + leaning(own[1], lean);
  mass[2] = mass[2] + upright(own[2], lean);
  mass[3] = mass[3] + leaning(own[1], steer);
  mass[4] = mass[4] + upright(own[2], steer);
  mass[5] = mass[5] + upright(own[2], speed);
}

ALWAYS void add_slope(const Forces& forces, const Rolling& r, Vector& gravity, Vector& front) {
  const Vector rear = {forces.road_forward, forces.road_across * r.c1,
                       -(forces.road_across * r.s1)};
  const Vector there = about_z(about_y(rear, r.s2, r.c2), r.s3, r.c3);
  gravity = {gravity.x + rear.x, gravity.y + rear.y, gravity.z + rear.z};
  front = {front.x + (r.cp * there.x + r.sp * there.z), front.y + there.y,
           front.z + (r.cp * there.z - r.sp * there.x)};
}

ALWAYS void coasting(const Constants& k, const State& pose, const Rolling& r, D yaw, D pitch,
                     const Rates& rear, const Rates& front, Change& rear_change,
                     Change& front_change) {
  const D s1 = r.s1, c1 = r.c1, s2 = r.s2, c2 = r.c2, s3 = r.s3, c3 = r.c3;
  const D across = r.across, sp = r.sp, cp = r.cp;
  const D lean_rate = pose.lean_rate, steer_rate = pose.steer_rate;

  const D roll = yaw * s1;
  const D leaning = k.rear_radius * lean_rate;
  const Vector up = {-(pitch * rear.turn), lean_rate * rear.turn,
                     pitch * lean_rate - lean_rate * roll};
  const Vector base = {-(2.0 * (leaning * rear.turn)), rear.ahead * rear.turn,
                       leaning * lean_rate - rear.ahead * roll};

  const Vector turning = about_z(about_y({lean_rate, rear.pitch, rear.turn}, s2, c2), s3, c3);
  Vector carried = about_z(about_y(up, s2, c2), s3, c3);
  Vector centre = about_z(about_y(base, s2, c2), s3, c3);
  const Vector swept = cross(carried, r.to_front);
  const Vector held = cross(turning, cross(turning, r.to_front));
  const D swing = steer_rate * k.fork_offset;
  centre = {centre.x + (swept.x + held.x) - (2.0 * (swing * turning.z) + steer_rate * swing),
            centre.y + (swept.y + held.y),
            centre.z + (swept.z + held.z) + 2.0 * (swing * turning.x)};
  carried = {carried.x + steer_rate * turning.y, carried.y - steer_rate * turning.x, carried.z};

  const Vector up_front = {ALONG(carried), carried.y, INTO(carried)};
  const D plane = (front.turn * r.flat) * across;
  D along = ALONG(centre);
  const D into = INTO(centre);
  D leaned = up_front.x + (front.pitch - plane) * front.turn;
  const D slip = centre.y - (front.ahead * front.turn + k.front_radius * leaned);
  const D sunk = k.front_radius * (front.lean * front.lean) - front.ahead * plane;
  const D pitch_up = -((across * slip + r.steep * (into - sunk)) * r.pitch_inverse);
  const D yaw_up = -((slip + r.pitch_slip * pitch_up) * r.yaw_inverse);

  const D back = k.rear_radius * (yaw_up * s1);
  rear_change = {{up.x, up.y + (yaw_up * s1 + pitch_up), up.z + yaw_up * c1},
                 {base.x - back, base.y, base.z},
                 -(leaning * rear.turn) - back};
  leaned = leaned + pitch_up * r.per_pitch.lean;
  along = along + (yaw_up * r.per_yaw.ahead + pitch_up * r.per_pitch.ahead);
  front_change = {{up_front.x + pitch_up * r.per_pitch.lean,
                   up_front.y + (yaw_up * r.per_yaw.pitch + pitch_up * r.per_pitch.pitch),
                   up_front.z + (yaw_up * r.per_yaw.turn + pitch_up * r.per_pitch.turn)},
                  {along, front.ahead * front.turn + k.front_radius * leaned, sunk},
                  along + k.front_radius * (front.lean * front.turn)};
}

ALWAYS void solved(const D* m, const D* load, Motion& o) {
  const D m11 = m[0], m12 = m[1], m13 = m[2], m22 = m[3], m23 = m[4], m33 = m[5];
  const D a11 = m22 * m33 - m23 * m23;
  const D a12 = m23 * m13 - m12 * m33;
  const D a13 = m12 * m23 - m22 * m13;
  const D a22 = m11 * m33 - m13 * m13;
  const D a23 = m12 * m13 - m11 * m23;
  const D a33 = m11 * m22 - m12 * m12;
  const D scale = 1.0 / (m11 * a11 + m12 * a12 + m13 * a13);
  o.lean = (a11 * load[0] + a12 * load[1] + a13 * load[2]) * scale;
  o.steer = (a12 * load[0] + a22 * load[1] + a23 * load[2]) * scale;
  o.speed = (a13 * load[0] + a23 * load[1] + a33 * load[2]) * scale;
  o.give[0] = a12 * scale;
  o.give[1] = a22 * scale;
  o.give[2] = a23 * scale;
}

ALWAYS D dot(Vector a, Vector b) { return a.x * b.x + a.y * b.y + a.z * b.z; }

ALWAYS Vector rider_inertia(const Constants& k, Vector a) {
  return {k.rider_xx * a.x + k.rider_xz * a.z, k.rider_yy * a.y,
          k.rider_xz * a.x + k.rider_zz * a.z};
}

ALWAYS void with_rider(const Constants& k, const State& pose, const Rolling& r, const Rates& rear,
                       const Change& change, Vector gravity, const Rates* partial, D* mass,
                       D* load) {
  D s4, c4;
  sine_cosine(pose.rider_lean, s4, c4);
  const D s2 = r.s2 * k.tilt_cosine - r.c2 * k.tilt_sine;
  const D c2 = r.c2 * k.tilt_cosine + r.s2 * k.tilt_sine;
  const D x = k.rider_x, z = k.rider_z, down = k.rider_down, zero = all(0.0);
#define LEANED(a) Vector{(a).x, c4 * (a).y + s4 * (a).z, c4 * (a).z - s4 * (a).y}
  Vector velocity[4], turning[4];
  for (int i = 0; i < 3; ++i) {
    const Rates own = partial[i];
    Vector about = about_y({own.lean, own.pitch, own.turn}, s2, c2);
    const Vector base = about_y({own.ahead, k.rear_radius * own.lean, zero}, s2, c2);
    const Vector swept = cross_plane(about, x, z);
    const Vector sum = {base.x + swept.x, base.y + swept.y, base.z + swept.z};
    const Vector point = LEANED(sum);
    about = LEANED(about);
    turning[i] = about;
    velocity[i] = {point.x + about.y * down, point.y - about.x * down, point.z};
  }
  turning[3] = {all(1.0), zero, zero};
  velocity[3] = {zero, -down, zero};

  Vector carried = about_y({rear.lean, rear.pitch, rear.turn}, s2, c2);
  Vector up = about_y(change.up, s2, c2);
  Vector base = about_y(change.base, s2, c2);
  const Vector swept = cross_plane(up, x, z), held = cross(carried, cross_plane(carried, x, z));
  base = {base.x + (swept.x + held.x), base.y + (swept.y + held.y), base.z + (swept.z + held.z)};
  base = LEANED(base);
  carried = LEANED(carried);
  up = LEANED(up);
  const D rate = pose.rider_rate;
  const Vector w = {carried.x + rate, carried.y, carried.z};
  up = {up.x, up.y + rate * carried.z, up.z - rate * carried.y};
  const D swing_x = w.y * down, swing_y = -(w.x * down);
  const Vector com = {base.x + up.y * down - w.z * swing_y, base.y - up.x * down + w.z * swing_x,
                      base.z + (w.x * swing_y - w.y * swing_x)};
  const Vector level = about_y(gravity, s2, c2);
  const Vector pull = LEANED(level);
  const Vector force = {k.rider_mass * (pull.x - com.x), k.rider_mass * (pull.y - com.y),
                        k.rider_mass * (pull.z - com.z)};
  const Vector change_up = rider_inertia(k, up), change_turn = cross(w, rider_inertia(k, w));
  const Vector torque = {-(change_up.x + change_turn.x), -(change_up.y + change_turn.y),
                         -(change_up.z + change_turn.z)};
  Vector momentum[4], angular[4];
  for (int i = 0; i < 4; ++i) {
    const Vector v = velocity[i];
    load[i] = dot(v, force) + dot(turning[i], torque);
    momentum[i] = {k.rider_mass * v.x, k.rider_mass * v.y, k.rider_mass * v.z};
    angular[i] = rider_inertia(k, turning[i]);
  }
  int entry = 0;
  for (int i = 0; i < 4; ++i) {
    for (int j = i; j < 4; ++j) {
      mass[entry++] = dot(velocity[i], momentum[j]) + dot(turning[i], angular[j]);
    }
  }
}

ALWAYS void solved_with_rider(const D* mass, const D* load, const D* m, const D* rider_load,
                              Motion& o) {
  const D share = 1.0 / m[9];
  const D c1 = m[3] * share, c2 = m[6] * share, c3 = m[8] * share;
  const D left[6] = {(mass[0] + m[0]) - c1 * m[3], (mass[1] + m[1]) - c1 * m[6],
                     (mass[2] + m[2]) - c1 * m[8], (mass[3] + m[4]) - c2 * m[6],
                     (mass[4] + m[5]) - c2 * m[8], (mass[5] + m[7]) - c3 * m[8]};
  const D pull = rider_load[3];
  const D pulled[3] = {(load[0] + rider_load[0]) - c1 * pull, (load[1] + rider_load[1]) - c2 * pull,
                       (load[2] + rider_load[2]) - c3 * pull};
  solved(left, pulled, o);
  o.rider = pull * share - (c1 * o.lean + c2 * o.steer + c3 * o.speed);
  o.give[3] = -(c1 * o.give[0] + c2 * o.give[1] + c3 * o.give[2]);
}

template <bool EXTRAS, bool RIDER>
ALWAYS Motion motion(const Constants& k, const State& pose, const Forces& forces,
                     const Rolling& r) {
  const D s1 = r.s1, c1 = r.c1, zero = all(0.0);
  const D lean_rate = pose.lean_rate, steer_rate = pose.steer_rate, speed = pose.speed;
  const D yaw = r.yaw[0] * lean_rate + r.yaw[1] * steer_rate + r.yaw[2] * speed;
  const D pitch = r.pitch[0] * lean_rate + r.pitch[1] * steer_rate;
  const D back = -(k.rear_radius * s1);
  const Rates rear_partial[3] = {
      {back * r.yaw[0], all(1.0), r.yaw[0] * s1 + r.pitch[0], r.yaw[0] * c1},
      {back * r.yaw[1], zero, r.yaw[1] * s1 + r.pitch[1], r.yaw[1] * c1},
      {back * r.yaw[2] + 1.0, zero, r.yaw[2] * s1, r.yaw[2] * c1}};
  const Rates rear = {speed + back * yaw, lean_rate, yaw * s1 + pitch, yaw * c1};
  const Rates *by_lean = &r.front[0], *by_steer = &r.front[1], *by_speed = &r.front[2];
  const Rates front = {
      by_lean->ahead * lean_rate + by_steer->ahead * steer_rate + by_speed->ahead * speed,
      by_lean->lean * lean_rate + by_steer->lean * steer_rate,
      by_lean->pitch * lean_rate + by_steer->pitch * steer_rate + by_speed->pitch * speed,
      by_lean->turn * lean_rate + by_steer->turn * steer_rate + by_speed->turn * speed};
  Change rear_change, front_change;
  coasting(k, pose, r, yaw, pitch, rear, front, rear_change, front_change);

  Vector gravity = {zero, k.gravity * s1, k.gravity * c1};
  Vector gravity_front = {zero, k.gravity * r.across, k.gravity * r.steep};
  if (EXTRAS) add_slope(forces, r, gravity, gravity_front);
  const Frame rear_frame = frame(k.rear_mass, k.rear_radius, k.rear_rotor, k.rear_x, k.rear_z,
                                 k.rear_xx, k.rear_yy, k.rear_zz, k.rear_xz, r.s2, r.c2);
  const Frame front_frame = frame(k.front_mass, k.front_radius, k.front_rotor, k.front_x,
                                  k.front_z, k.front_xx, k.front_yy, k.front_zz, k.front_xz, r.sp,
                                  r.cp);
  Load rear_load = load_of(rear_frame, rear, rear_change, gravity);
  Load front_load = load_of(front_frame, front, front_change, gravity_front);
  if (EXTRAS) {
    rear_load = {rear_load.ahead + (forces.force.x - forces.rear_rolling),
                 rear_load.lean + (k.rear_radius * forces.force.y + forces.torque.x),
                 rear_load.pitch + forces.torque.y, rear_load.turn + forces.torque.z};
    front_load.ahead = front_load.ahead - forces.front_rolling;
  }
  const D turned = forces.rim_force * k.rear_radius;
  const D load[3] = {
      (upright(rear_partial[0], rear_load) + rear_load.lean) + leaning(r.front[0], front_load) +
          r.pitch[0] * turned,
      upright(rear_partial[1], rear_load) + leaning(r.front[1], front_load) +
          (r.pitch[1] * turned + forces.steer_torque),
      upright(rear_partial[2], rear_load) + upright(r.front[2], front_load) + forces.rim_force};
  D mass[6];
  add_rear_mass(rear_frame, rear_partial, mass);
  add_front_mass(front_frame, r.front, mass);
  Motion o;
  o.yaw_rate = yaw;
  o.pitch_rate = pitch;
  o.front_spin = front.ahead + k.front_radius * front.pitch;
  o.rider = zero;
  o.give[3] = zero;
  if (RIDER) {
    D rider_mass[10], rider_load[4];
    with_rider(k, pose, r, rear, rear_change, gravity, rear_partial, rider_mass, rider_load);
    rider_load[3] = rider_load[3] + forces.rider_torque;
    solved_with_rider(mass, load, rider_mass, rider_load, o);
  } else {
    solved(mass, load, o);
  }
  return o;
}

// integrate.py

ALWAYS D motor(const Constants& k, D torque, D wanted) {
  D target = wanted - bounded(wanted, -k.motor_dead, k.motor_dead);
  target = bounded(target, -k.motor_limit, k.motor_limit);
  const D change =
      bounded(k.motor_share * (target - torque), -k.motor_change, k.motor_change);
  return k.motor_instant > 0.5 ? target : torque + change;
}

ALWAYS D fade(D speed) { return bounded(10.0 * speed, -1.0, 1.0); }

ALWAYS D rim_force(const Constants& k, const Inputs& u, D pedal, D speed) {
  const D slow = u.speed_low - speed, fast = speed - u.speed_high;
  D wanted = pedal + k.governor * (slow > 0.0 ? slow : all(0.0));
  wanted = wanted - k.governor * (fast > 0.0 ? fast : all(0.0));
  const D most = k.power / (speed < 1.0 ? all(1.0) : speed);
  wanted = bounded(wanted, -k.brake, most);
  return wanted < 0.0 ? wanted * fade(speed) : wanted;
}

ALWAYS D rider_torque(const Constants& k, const State& stage, D displacement,
                           const Rolling& r) {
  D sine, cosine;
  sine_cosine(stage.rider_lean, sine, cosine);
  const D wanted = bounded(k.muscle_gain * displacement, -0.7, 0.7);
  D muscle = k.muscle_stiffness * (wanted - sine) - k.muscle_damping * stage.rider_rate;
  muscle = muscle - k.muscle_weight * (r.s1 * cosine + r.c1 * sine);
  muscle = bounded(muscle, -k.muscle_limit, k.muscle_limit);
  return muscle - (k.passive_stiffness * stage.rider_lean + k.passive_damping * stage.rider_rate);
}

ALWAYS void outside(const Constants& k, const State& stage, const Inputs& u, const Rolling& r,
                    D sine, D cosine, Forces& forces) {
  const D along = (u.wind_y * cosine - u.wind_x * sine) - stage.speed;
  const D side = -(u.wind_x * cosine + u.wind_y * sine);
  const D push = k.drag * (along * size(along));
  const D shove = k.side_drag * (side * size(side));
  const D across = shove * r.c1, below = -(shove * r.s1);
  const D fading = fade(stage.speed);
  forces.road_forward = k.gravity_y * cosine - k.gravity_x * sine;
  forces.road_across = -(k.gravity_x * cosine + k.gravity_y * sine);
  forces.force = {push, across + u.force_across, below};
  forces.torque = {u.torque_x - k.pressure_down * across,
                   k.pressure_down * push - k.pressure_forward * below,
                   u.torque_z + k.pressure_forward * across};
  forces.rear_rolling = k.rear_rolling * fading;
  forces.front_rolling = k.front_rolling * fading;
}

// What Runge-Kutta integrates: the first members of `State`.
struct Slopes { D value[MOVING]; };

template <bool EXTRAS, bool RIDER>
ALWAYS Motion slopes_of(const Constants& k, const State& stage, const Inputs& u, D torque, D pedal,
                        D displacement, const Rolling& r, Slopes& slopes) {
  D sine, cosine;
  sine_cosine_of_turn(stage.heading, sine, cosine);
  Forces forces;
  forces.steer_torque = torque - k.damping * stage.steer_rate;
  forces.rim_force = rim_force(k, u, pedal, stage.speed);
  if (EXTRAS) outside(k, stage, u, r, sine, cosine, forces);
  if (RIDER) forces.rider_torque = rider_torque(k, stage, displacement, r);
  const Motion m = motion<EXTRAS, RIDER>(k, stage, forces, r);
  const D speed = stage.speed;
  slopes = {{stage.lean_rate, m.lean, stage.steer_rate, m.steer, m.yaw_rate, -(speed * sine),
             speed * cosine, m.speed, m.pitch_rate, speed * k.rear_curvature + m.pitch_rate,
             m.front_spin * k.front_curvature, stage.rider_rate, m.rider}};
  return m;
}

// What friction and stop do to the steering during one substep.
struct Grip { Mask sticks, rests; D torque; };

ALWAYS Grip grip_of(const Constants& k, const State& now, D steer_up, D give, double h) {
  const D needed = -(now.steer_rate / h + steer_up) / give;
  const Mask resting = now.steer_rate == 0.0;
  const D strength = resting ? k.stiction : k.friction;
  const Mask at_left = now.steer_angle >= k.stop, at_right = now.steer_angle <= -k.stop;
  const D low = at_left ? all(-UNLIMITED) : -strength;
  const D high = at_right ? all(UNLIMITED) : strength;
  const Mask holds = (needed >= low) & (needed <= high) & (low < high);
  const D slides = bounded(needed, at_left ? all(-UNLIMITED) : -k.friction,
                           at_right ? all(UNLIMITED) : k.friction);
  return {holds & resting, holds, holds ? needed : slides};
}

ALWAYS Mask rideable(const Constants& k, const State& now, const Rolling& r) {
  return (now.stopped == 0.0) & (size(now.lean_angle) < LIES) & (r.yaw_lever > k.turn_limit) &
         (r.pitch_lever < -k.turn_limit);
}

template <bool EXTRAS, bool RIDER>
ALWAYS void substep(const Constants& k, State& now, const Inputs& u, int index, int substeps,
                    double h) {
  constexpr int moving = RIDER ? MOVING : WITHOUT_RIDER;
  const D early = bounded(k.delay_share * (2.0 * substeps) - 2.0 * index, 0.0, 1.0);
  const D late = bounded(k.delay_share * (2.0 * substeps) - (2.0 * index + 1.0), 0.0, 1.0);
  const D older = 0.5 * (early + late);
  const D begun = now.motor_torque;
  const D middle = motor(k, begun, early * u.torque_before + (1.0 - early) * u.torque);
  const D ended = motor(k, middle, late * u.torque_before + (1.0 - late) * u.torque);
  const D mean = 0.5 * (middle + ended);
  const Mask instant = k.motor_instant > 0.5;
  const D torques[3] = {instant ? mean : begun, instant ? mean : middle, instant ? mean : ended};
  const D pedal = k.gear * (older * u.pedal_before + (1.0 - older) * u.pedal);
  const D displacement = older * u.displacement_before + (1.0 - older) * u.displacement;

  State stage = now;
  D total[MOVING] = {};
  Grip grip = {};
  Mask rides = {};
  for (int number = 0; number < 4; ++number) {
    const Rolling r = rolling(k, stage.lean_angle, stage.pitch, stage.steer_angle);
    Slopes slopes;
    const Motion m = slopes_of<EXTRAS, RIDER>(k, stage, u, torques[(number + 1) / 2], pedal,
                                              displacement, r, slopes);
    if (number == 0) {
      grip = grip_of(k, now, m.steer, m.give[1], h);
      rides = rideable(k, now, r);
    }
    const D held = grip.sticks ? -(m.steer / m.give[1]) : grip.torque;
    const D moved = m.steer + m.give[1] * held;
    slopes.value[LEAN_RATE] = m.lean + m.give[0] * held;
    slopes.value[STEER_RATE] = grip.sticks ? all(0.0) : moved;
    slopes.value[SPEED] = m.speed + m.give[2] * held;
    slopes.value[RIDER_RATE] = m.rider + m.give[3] * held;
    const double weight = number == 1 || number == 2 ? 2.0 : 1.0, ahead = number == 2 ? h : 0.5 * h;
    for (int i = 0; i < moving; ++i) {
      const D slope = slopes.value[i];
      total[i] = number == 0 ? slope : total[i] + weight * slope;
      rows(stage)[i] = rows(now)[i] + ahead * slope;
    }
  }

  State moved = now;
  for (int i = 0; i < moving; ++i) rows(moved)[i] = rows(now)[i] + (h / 6.0) * total[i];
  moved.motor_torque = ended;
  moved.steer_rate = grip.rests ? all(0.0) : moved.steer_rate;
  moved.steer_angle = bounded(moved.steer_angle, -k.stop, k.stop);
  const D heading = moved.heading > PI ? moved.heading - 2.0 * PI : moved.heading;
  moved.heading = heading <= -PI ? heading + 2.0 * PI : heading;
  const Mask goes_on = rides & (size(moved.lean_rate) < 100.0) &
                       (size(moved.steer_rate) < 1000.0) & (size(moved.speed) < 100.0);
  for (int i = 0; i < STATE_ROWS; ++i) {
    rows(now)[i] = goes_on ? rows(moved)[i] : rows(now)[i];
  }
  now.stopped = goes_on ? now.stopped : all(1.0);
}

template <bool EXTRAS, bool RIDER>
ALWAYS void advance(const Constants& k, State& now, const Inputs& u, const Task& task) {
  const double h = task.time_step / task.substeps;
  for (int index = task.first; index < task.last; ++index) {
    substep<EXTRAS, RIDER>(k, now, u, index, task.substeps, h);
  }
  const Rolling r = rolling(k, now.lean_angle, now.pitch, now.steer_angle);
  D forward, across, sine, cosine;
  front_contact(k, r, forward, across);
  sine_cosine_of_turn(now.heading, sine, cosine);
  now.front_x = now.rear_x - (sine * forward + cosine * across);
  now.front_y = now.rear_y + (cosine * forward - sine * across);
  const D turning = r.yaw[0] * now.lean_rate + r.yaw[1] * now.steer_rate;
  now.yaw_rate = turning + r.yaw[2] * now.speed;
}

// A row's entries for LANES bicycles from `base` on; the last one again where there are fewer.
ALWAYS D gather(const double* row, long length, long base) {
  D found = {};
  for (int l = 0; l < LANES; ++l) found[l] = row[base + l < length ? base + l : length - 1];
  return found;
}

template <bool EXTRAS, bool RIDER>
void run(const Task& task) {
  Constants k = {};
  State now = {};
  Inputs u = {};
  for (long base = 0; base < task.count; base += LANES) {
    if (base == 0 || task.different > 1) {
      for (int i = 0; i < CONSTANT_ROWS; ++i) {
        rows(k)[i] = gather(task.constants + i * task.different, task.different, base);
      }
    }
    for (int i = 0; i < STATE_ROWS; ++i) {
      rows(now)[i] = gather(task.state + i * task.count, task.count, base);
    }
    for (int i = 0; i < INPUT_ROWS; ++i) {
      rows(u)[i] = gather(task.inputs[i], task.lengths[i], base);
    }
    advance<EXTRAS, RIDER>(k, now, u, task);
    for (int i = 0; i < STATE_ROWS; ++i) {
      for (long l = 0; l < LANES && base + l < task.count; ++l) {
        task.state[i * task.count + base + l] = rows(now)[i][l];
      }
    }
  }
}

void any(const Task& task, int extras, int rider) {
  if (rider) {
    run<true, true>(task);
  } else if (extras) {
    run<true, false>(task);
  } else {
    run<false, false>(task);
  }
}

#undef ALONG
#undef INTO
#undef LEANED
