// One step of `BicycleTask` for N bicycles; `native_task.py` prepares what it takes.
//
// The same bits as dynamics.py, geometry.py, reward.py and task.py give in numpy: every operation
// stands in their order, none is contracted, and what IEEE 754 leaves open (sine, arc tangent,
// the sign of a zero that a maximum returns) is left to numpy's own inner loops. The equations and
// rows named here are those that the numpy code names.

#include <cmath>
#include <cstdint>

#if defined(__x86_64__) && defined(__gnu_linux__)
#define WIDEST __attribute__((target_clones("avx512f", "avx2", "default")))
#else
#define WIDEST
#endif

extern "C" {

struct Loop {  // of a ufunc, for doubles
  void (*call)(char** arrays, const intptr_t* count, const intptr_t* strides, void* data);
  void* data;
};

struct Model {
  Loop sin, cos, arctan, arcsin, arctan2, maximum, minimum;
  double lowest[3], highest[3];  // T, d, F
  double time_step, pedal, mass_height, tyre_radius, tyre_spin, wheelbase, mass_offset, tyres;
  double turning, gravity, lean_inertia, coupling, steer_inertia, steer_stop, drift;
  double speed_low, speed_high, fall_angle, goal_radius, weights[4];
  int64_t most_steps, limit_speed, chord_follows_steering, stop_absorbs_steering;
};

struct Arrays {  // rows of N; the states in the order of State's fields
  const double *action, *noise, *state, *goal_x, *goal_y;
  const int64_t* steps;
  const bool* fallen;
  const double* frozen_reward;
  double* result;  // see ROWS of native_task.py
  bool* ends;      // terminated, truncated, fallen
  const double* share;  // of an environment's actions: (N, actions)
  float* observation;   // as it gives it, (N, 6)
};

struct Face {  // how an environment scales
  int64_t actions, driven[3];
  double limit[3], bound[6], scale[6];
  float high[6];
};

}  // extern "C"

namespace {

constexpr long BLOCK = 128;  // bicycles whose numbers stay in the first cache together
constexpr double TURN = 2.0 * 3.141592653589793;

enum { LEAN, LEAN_RATE, LEAN_ACCELERATION, STEER, STEER_RATE, HEADING, FRONT_X, FRONT_Y, REAR_X, REAR_Y, SPEED, STATES };
enum { OBSERVED = STATES, REWARD = OBSERVED + 6, TERMS, DISTANCE = TERMS + 4, STEPS };

struct alignas(64) Row {
  double at[BLOCK];
};

void one(const Loop& loop, const double* from, Row& to, long n) {
  char* arrays[] = {(char*)from, (char*)to.at};
  const intptr_t count = n, strides[] = {8, 8};
  loop.call(arrays, &count, strides, loop.data);
}

void two(const Loop& loop, const double* left, intptr_t step, const double* right, intptr_t other, double* to, long n) {
  char* arrays[] = {(char*)left, (char*)right, (char*)to};
  const intptr_t count = n, strides[] = {step, other, 8};
  loop.call(arrays, &count, strides, loop.data);
}

template <typename Number>
inline Number clipped(Number value, Number low, Number high) {
  return value < low ? low : value > high ? high : value;
}
inline double sign(double value) { return value > 0.0 ? 1.0 : value < 0.0 ? -1.0 : value == 0.0 ? 0.0 : value; }

struct Bicycles {  // up to BLOCK of them, from number `first` on
  const Model& m;
  const Arrays& a;
  const long all, first, n;
  Row torque, displacement, pedal, front, rear, mass, tilt;
  Row next[STATES], &speed = next[SPEED];  // after the step, whether it lay or not
  Row ahead, behind, p, q, r, s;

  Bicycles(const Model& model, const Arrays& arrays, long all, long first)
      : m(model), a(arrays), all(all), first(first), n(all - first < BLOCK ? all - first : BLOCK) {}

  const double* old(int row) const { return a.state + row * all + first; }
  double* out(int row) const { return a.result + row * all + first; }

  void wanted(int which, Row& to) {
    const double* from = a.action + 3 * first + which;
    two(m.maximum, from, 24, &m.lowest[which], 0, p.at, n);
    two(m.minimum, p.at, 8, &m.highest[which], 0, to.at, n);
  }

  WIDEST void accelerate() {  // equations 11 to 13
    const double* before = old(SPEED);
    for (long i = 0; i < n; i++) {
      const double faster = before[i] + m.time_step * (pedal.at[i] * m.pedal);
      speed.at[i] = m.limit_speed ? clipped(faster, m.speed_low, m.speed_high) : faster;
      q.at[i] = displacement.at[i] / m.mass_height;
    }
  }

  WIDEST void curvatures() {  // equations 3 and 4; p and q hold the steering's sine and cosine
    const double* lean = old(LEAN);
    for (long i = 0; i < n; i++) {
      const double sine = std::fabs(p.at[i]);
      front.at[i] = sine / m.wheelbase;
      rear.at[i] = sine / (m.wheelbase * q.at[i]);
      const double offset = m.mass_offset * rear.at[i];
      mass.at[i] = rear.at[i] / std::sqrt(1.0 + offset * offset);
      tilt.at[i] = lean[i] + tilt.at[i];  // equation 6
    }
  }

  WIDEST void turn() {  // equations 5 and 7; p and q hold the tilt's sine and cosine
    const double *lean = old(LEAN), *lean_rate = old(LEAN_RATE), *steer = old(STEER), *steer_rate = old(STEER_RATE);
    const double* heading = old(HEADING);
    for (long i = 0; i < n; i++) {
      const double wheel_rate = speed.at[i] / m.tyre_radius;
      const double turning = m.tyres * (front.at[i] + rear.at[i]) + m.turning * mass.at[i];
      const double centrifugal = sign(steer[i]) * speed.at[i] * speed.at[i] * turning;
      const double gyroscopic = m.tyre_spin * wheel_rate * steer_rate[i];
      const double acceleration = (m.gravity * p.at[i] - q.at[i] * (gyroscopic + centrifugal)) / m.lean_inertia;
      const double steering = (torque.at[i] + m.coupling * wheel_rate * lean_rate[i]) / m.steer_inertia;
      next[LEAN_ACCELERATION].at[i] = acceleration;
      next[LEAN_RATE].at[i] = lean_rate[i] + acceleration * m.time_step;
      next[LEAN].at[i] = lean[i] + next[LEAN_RATE].at[i] * m.time_step;
      const double rate = steer_rate[i] + steering * m.time_step;
      const double free_angle = steer[i] + rate * m.time_step;
      const double angle = clipped(free_angle, -m.steer_stop, m.steer_stop);
      next[STEER].at[i] = angle;
      next[STEER_RATE].at[i] = m.stop_absorbs_steering && free_angle != angle ? 0.0 : rate;
      const double half = 0.5 * (speed.at[i] * m.time_step);
      r.at[i] = clipped(half * front.at[i], -1.0, 1.0);
      s.at[i] = clipped(half * rear.at[i], -1.0, 1.0);
      ahead.at[i] = heading[i] + angle;
    }
  }

  WIDEST void point() {  // the chords' directions; p and q hold their half angles
    const double* heading = old(HEADING);
    for (long i = 0; i < n; i++) {
      const double pointing = ahead.at[i], steer = next[STEER].at[i];
      const double front_side = sign(m.chord_follows_steering ? steer : pointing);
      const double rear_side = sign(m.chord_follows_steering ? steer : heading[i]);
      ahead.at[i] = pointing + front_side * p.at[i];
      behind.at[i] = heading[i] + rear_side * q.at[i];
    }
  }

  WIDEST void roll() {  // equations 1 and 2; p, q, r, s: sine and cosine ahead and behind
    const double *front_x = old(FRONT_X), *front_y = old(FRONT_Y), *rear_x = old(REAR_X), *rear_y = old(REAR_Y);
    for (long i = 0; i < n; i++) {
      const double travel = speed.at[i] * m.time_step;
      const double fx = front_x[i] - travel * p.at[i], fy = front_y[i] + travel * q.at[i];
      const double rx = rear_x[i] - travel * r.at[i], ry = rear_y[i] + travel * s.at[i];
      const double along_x = rx - fx, along_y = ry - fy;
      const double distance = std::sqrt(along_x * along_x + along_y * along_y);
      const double drifted = (m.wheelbase - distance) / distance;
      const double stretch = std::fabs(distance - m.wheelbase) > m.drift ? drifted : 0.0;
      next[FRONT_X].at[i] = fx;
      next[FRONT_Y].at[i] = fy;
      next[REAR_X].at[i] = rx + along_x * stretch;
      next[REAR_Y].at[i] = ry + along_y * stretch;
      p.at[i] = next[REAR_X].at[i] - fx;
      q.at[i] = fy - next[REAR_Y].at[i];
    }
  }

  WIDEST void keep() {  // a fallen bicycle stays as it was; then the way to the goal
    const bool* lay = a.fallen + first;
    for (int row = 0; row < STATES; row++) {
      const double* before = old(row);
      double* to = out(row);
      for (long i = 0; i < n; i++) to[i] = lay[i] ? before[i] : next[row].at[i];
    }
    const double *x = out(REAR_X), *y = out(REAR_Y);
    for (long i = 0; i < n; i++) {
      p.at[i] = x[i] - a.goal_x[first + i];
      q.at[i] = a.goal_y[first + i] - y[i];
    }
  }

  WIDEST void outcome() {  // equation 20 and the ends; r holds the bearing of the goal
    const double *lean = out(LEAN), *lean_rate = out(LEAN_RATE), *acceleration = out(LEAN_ACCELERATION);
    const double *steer = out(STEER), *steer_rate = out(STEER_RATE), *heading = out(HEADING);
    const double *x = out(REAR_X), *y = out(REAR_Y), *frozen = a.frozen_reward + first;
    const bool* lay = a.fallen + first;
    bool *reached = a.ends + first, *cut = reached + all, *lies = cut + all;
    int64_t* steps = reinterpret_cast<int64_t*>(out(STEPS));
    double *seen[6], *terms[4], *reward = out(REWARD), *distance = out(DISTANCE);
    for (int k = 0; k < 6; k++) seen[k] = out(OBSERVED + k);
    for (int k = 0; k < 4; k++) terms[k] = out(TERMS + k);
    for (long i = 0; i < n; i++) {
      const double off = heading[i] - r.at[i];
      const double error = off - TURN * std::ceil(off / TURN - 0.5);
      seen[0][i] = steer[i];
      seen[1][i] = steer_rate[i];
      seen[2][i] = lean[i];
      seen[3][i] = lean_rate[i];
      seen[4][i] = acceleration[i];
      seen[5][i] = error;
      const double first_term = -m.weights[0] * lean[i] * lean[i];
      const double second = -m.weights[1] * lean_rate[i] * lean_rate[i];
      const double third = -m.weights[2] * acceleration[i] * acceleration[i];
      const double last = -m.weights[3] * error * error;
      terms[0][i] = first_term;
      terms[1][i] = second;
      terms[2][i] = third;
      terms[3][i] = last;
      reward[i] = lay[i] ? frozen[i] : first_term + second + third + last;
      const double dx = a.goal_x[first + i] - x[i], dy = a.goal_y[first + i] - y[i];
      distance[i] = std::sqrt(dx * dx + dy * dy);
    }
    for (long i = 0; i < n; i++) {
      steps[i] = a.steps[first + i] + 1;
      lies[i] = lay[i] | (std::fabs(lean[i]) > m.fall_angle);
      reached[i] = !lies[i] & (distance[i] <= m.goal_radius);
      cut[i] = !reached[i] & (steps[i] >= m.most_steps);
    }
  }

  void step() {
    wanted(0, torque);
    wanted(1, displacement);
    wanted(2, pedal);
    for (long i = 0; a.noise && i < n; i++) displacement.at[i] += a.noise[first + i];
    accelerate();
    one(m.arctan, q.at, tilt, n);
    one(m.sin, old(STEER), p, n);
    one(m.cos, old(STEER), q, n);
    curvatures();
    one(m.sin, tilt.at, p, n);
    one(m.cos, tilt.at, q, n);
    turn();
    one(m.arcsin, r.at, p, n);
    one(m.arcsin, s.at, q, n);
    point();
    one(m.sin, ahead.at, p, n);
    one(m.cos, ahead.at, q, n);
    one(m.sin, behind.at, r, n);
    one(m.cos, behind.at, s, n);
    roll();
    two(m.arctan2, p.at, 8, q.at, 8, next[HEADING].at, n);
    keep();
    two(m.arctan2, p.at, 8, q.at, 8, r.at, n);
    outcome();
  }
};

}  // namespace

extern "C" {

// 1 where an action is not finite; nothing is written then.
int task_step(const Model* model, const Arrays* arrays, const long* count) {
  const long all = *count;
  for (long i = 0; i < 3 * all; i++)
    if (!std::isfinite(arrays->action[i])) return 1;
  for (long first = 0; first < all; first += BLOCK) {
    Bicycles(*model, *arrays, all, first).step();
  }
  return 0;
}

// The same from an environment's actions, with its observations.
int env_step(const Model* model, const Arrays* arrays, const long* count, const Face* face) {
  const long all = *count;
  double* physical = const_cast<double*>(arrays->action);
  for (long i = 0; i < all; i++) {
    for (int k = 0; k < 3; k++) physical[3 * i + k] = 0.0;
    for (int64_t k = 0; k < face->actions; k++)
      physical[3 * i + face->driven[k]] = clipped(arrays->share[i * face->actions + k], -1.0, 1.0) * face->limit[k];
  }
  if (task_step(model, arrays, count)) return 1;
  for (long i = 0; i < all; i++) {
    for (int k = 0; k < 6; k++) {
      const double seen = arrays->result[(OBSERVED + k) * all + i];
      const float scaled = (float)(clipped(seen, -face->bound[k], face->bound[k]) / face->scale[k]);
      arrays->observation[6 * i + k] = clipped(scaled, -face->high[k], face->high[k]);
    }
  }
  return 0;
}

}  // extern "C"
