// One step of `BicycleTask` for N bicycles; `native_task.py` prepares what it takes.
//
// The same bits as the plant, reward.py and task.py give in numpy, see ../plants/compiled.h. The
// bicycle is stepped by the plant's own compiled step.

#include <cmath>
#include <cstdint>
#include <cstring>

#include "../plants/choi/step.h"

using Plant = choi::Step;  // the one that moves the bicycles

extern "C" {

struct Model {
  Loops loops;
  SpeedLimits speed_limits;
  const Plant::Numbers* plant;
  double lowest[3], highest[3];  // T, d, F
  double fall_angle, goal_radius, weights[4];
  int64_t most_steps;
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

constexpr double TURN = 2.0 * 3.141592653589793;

enum { OBSERVED = STATES, REWARD = OBSERVED + 6, TERMS, DISTANCE = TERMS + 4, STEPS };

struct Bicycles : Plant {  // up to BLOCK of them, from number `first` on
  const Model& m;
  const Arrays& a;
  const long first;

  Bicycles(const Model& model, const Arrays& arrays, long all, long first)
      : Plant(*model.plant, model.loops, model.speed_limits, arrays.state + first, all, all - first < BLOCK ? all - first : BLOCK),
        m(model), a(arrays), first(first) {}

  double* out(int row) const { return a.result + row * all + first; }

  void wanted(int which, Row& to) {
    const double* from = a.action + 3 * first + which;
    two(loops.maximum, from, 24, &m.lowest[which], 0, p.at, n);
    two(loops.minimum, p.at, 8, &m.highest[which], 0, to.at, n);
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
    make();
    keep();
    two(loops.arctan2, p.at, 8, q.at, 8, r.at, n);
    outcome();
  }
};

}  // namespace

extern "C" {

// True if this library steps that plant, and both sides mean the same memory.
bool task_fits(const char* plant, const long* model, const long* numbers) {
  return !std::strcmp(plant, Plant::NAME) && *model == sizeof(Model) && *numbers == sizeof(Plant::Numbers);
}

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
