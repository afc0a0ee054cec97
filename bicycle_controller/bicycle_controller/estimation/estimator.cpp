// arithmetic.py compiled, one bicycle after another.
//
// Every function has the operations of its namesake in Python, in the same order, and products
// are rounded before they are added, so that both give the same bits.

#include <cmath>

#include "compiler.h"

namespace {

enum { LEAN, LEAN_RATE, STEER, STEER_RATE, GUST, SPEED, ROLL_BIAS, YAW_BIAS, FORCE_BIAS, OFFSET };
enum { STATES = 10, HEADING = STATES, X, Y, WIDTH, MOVING = 5 };
enum { ROLL_TURN, YAW_TURN, SIDE_FORCE };

constexpr double PI = 3.14159265358979323846, GRAVITY = 9.81, STEP = 0.01;
constexpr double STEEPEST_STEER = 1.2, STEEPEST_LEAN = 1.5, SLOWEST = 0.1, TURN_SHARE = 0.05;

#define NUMBERS(M)                                                                       \
  M(roll_noise) M(torque_noise) M(gust_noise) M(speed_noise) M(gyro_walk) M(force_walk)  \
  M(offset_walk) M(course_noise) M(gust_decay) M(turn_noise) M(turn_model)               \
  M(force_noise) M(force_model) M(ahead) M(height)

#define MEMBER(name) double name;
struct Numbers { NUMBERS(MEMBER) };
#undef MEMBER

}  // namespace

extern "C" {

struct Bicycles {
  long count;
  long kinds;             // 1, or one for each bicycle
  const double* powers;   // 3 x kinds x 3 x 4
  const double* per;      // kinds x 3, rows per N m
  const double* friction; // kinds
  const double* pitch;    // 3
  const Numbers* numbers;
  double* state;          // count x WIDTH
  double* covariance;     // count x STATES x STATES
  double* course;         // count x 3 x 3
  const double* torque;   // count
  const double* moving;   // count
};

}  // extern "C"

namespace {

typedef double Axes[3][4];
struct Rates { double lean, steer, yaw, sine, cosine, tangent; };

double bounded(double value, double most) {
  const double below = value > most ? most : value;
  return value < -most ? -most : below;
}

typedef double D;
#include "sine.h"

double wrapped(double angle) {
  const double turn = 2.0 * PI;
  angle = angle > PI ? angle - turn : angle;
  return angle < -PI ? angle + turn : angle;
}

template <int I, int K, int J>
void product(const double (&a)[I][K], const double (&b)[K][J], double (&found)[I][J]) {
  for (int i = 0; i < I; ++i)
    for (int j = 0; j < J; ++j) {
      double sum = a[i][0] * b[0][j];
      for (int k = 1; k < K; ++k) sum = sum + a[i][k] * b[k][j];
      found[i][j] = sum;
    }
}

template <int I, int J>
void transposed(const double (&a)[I][J], double (&found)[J][I]) {
  for (int i = 0; i < I; ++i)
    for (int j = 0; j < J; ++j) found[j][i] = a[i][j];
}

// One bicycle of many.
struct One {
  const Bicycles& all;
  const Numbers& n;
  long index, kind;
  const double *per;
  double friction, torque, moving;
  double (*p)[STATES];
  double (*course)[3];

  One(const Bicycles& all, long index)
      : all(all), n(*all.numbers), index(index), kind(all.kinds > 1 ? index : 0),
        per(all.per + 3 * kind), friction(all.friction[kind]), torque(all.torque[index]),
        moving(all.moving[index]),
        p(reinterpret_cast<double(*)[STATES]>(all.covariance + index * STATES * STATES)),
        course(reinterpret_cast<double(*)[3]>(all.course + index * 9)) {}

  void axes(const double* state, Axes& found) const {
    const double v = state[SPEED];
    const double* constant = all.powers + 12 * kind;
    const double* first = constant + 12 * all.kinds;
    const double* second = first + 12 * all.kinds;
    for (int i = 0; i < 12; ++i)
      found[i / 4][i % 4] = constant[i] + v * (first[i] + v * second[i]);
  }

  Rates rates(const Axes& axes, const double* state, double dt) const {
    Rates found;
    sine_cosine(bounded(state[LEAN], STEEPEST_LEAN), found.sine, found.cosine);
    double steer_sine, steer_cosine;
    sine_cosine(bounded(state[STEER], STEEPEST_STEER), steer_sine, steer_cosine);
    found.tangent = steer_sine / steer_cosine;
    const double bent[4] = {found.sine, state[LEAN_RATE], found.tangent, state[STEER_RATE]};
    double row[3];
    for (int r = 0; r < 3; ++r)
      row[r] = ((axes[r][0] * bent[0] + axes[r][1] * bent[1]) + axes[r][2] * bent[2]) +
               axes[r][3] * bent[3];
    row[0] = row[0] + axes[0][0] * state[GUST];
    row[1] = row[1] + axes[1][0] * state[GUST];
    row[2] = row[2] / found.cosine;
    for (int r = 0; r < 3; ++r) row[r] = row[r] + per[r] * torque;
    const double needed = -(state[STEER_RATE] / dt + row[1]) / per[1];
    double held = needed < -friction ? -friction : needed;
    held = held > friction ? friction : held;
    for (int r = 0; r < 3; ++r) row[r] = row[r] + per[r] * held;
    found.lean = row[0];
    found.steer = row[1];
    found.yaw = row[2];
    return found;
  }

  void move(double* state, double dt) const {
    Axes k;
    axes(state, k);
    const double share = dt * moving, half = 0.5 * share;
    const Rates first = rates(k, state, dt);
    double middle[WIDTH];
    for (int i = 0; i < WIDTH; ++i) middle[i] = state[i];
    middle[LEAN] += half * state[LEAN_RATE];
    middle[LEAN_RATE] += half * first.lean;
    middle[STEER] += half * state[STEER_RATE];
    middle[STEER_RATE] += half * first.steer;
    const Rates second = rates(k, middle, 0.5 * dt);
    state[LEAN] += share * middle[LEAN_RATE];
    state[LEAN_RATE] += share * second.lean;
    state[STEER] += share * middle[STEER_RATE];
    state[STEER_RATE] += share * second.steer;
    state[GUST] -= share * (n.gust_decay * state[GUST]);
    const double turned = second.yaw * share;
    double sine, cosine;
    sine_cosine_of_turn(state[HEADING] + 0.5 * turned, sine, cosine);
    const double way = state[SPEED] * share;
    state[X] -= way * sine;
    state[Y] += way * cosine;
    state[HEADING] = wrapped(state[HEADING] + turned);
  }

  void spread(const Axes& axes, double dt) const {
    double part[MOVING][MOVING] = {}, square[MOVING][MOVING];
    part[LEAN][LEAN_RATE] = part[STEER][STEER_RATE] = dt;
    for (int j = 0; j < GUST; ++j) {
      part[LEAN_RATE][j] = axes[0][j] * dt;
      part[STEER_RATE][j] = axes[1][j] * dt;
    }
    part[LEAN_RATE][GUST] = axes[0][0] * dt;
    part[STEER_RATE][GUST] = axes[1][0] * dt;
    part[GUST][GUST] = -n.gust_decay * dt;
    product(part, part, square);
    double grown[MOVING][MOVING], turned[MOVING][MOVING];
    for (int i = 0; i < MOVING; ++i)
      for (int j = 0; j < MOVING; ++j) {
        grown[i][j] = (part[i][j] + 0.5 * square[i][j]) * moving;
        grown[i][j] = grown[i][j] + (i == j ? 1.0 : 0.0);
      }
    transposed(grown, turned);
    constexpr int STILL = STATES - MOVING;
    double own[MOVING][MOVING], other[MOVING][STILL];
    for (int i = 0; i < MOVING; ++i) {
      for (int j = 0; j < MOVING; ++j) own[i][j] = p[i][j];
      for (int j = 0; j < STILL; ++j) other[i][j] = p[i][MOVING + j];
    }
    double half[MOVING][MOVING], block[MOVING][MOVING], across[MOVING][STILL];
    product(grown, own, half);
    product(half, turned, block);
    product(grown, other, across);
    for (int i = 0; i < MOVING; ++i) {
      for (int j = 0; j < MOVING; ++j) p[i][j] = 0.5 * (block[i][j] + block[j][i]);
      for (int j = 0; j < STILL; ++j) p[i][MOVING + j] = p[MOVING + j][i] = across[i][j];
    }

    const double go = dt * moving, by_torque = n.torque_noise * go;
    p[LEAN_RATE][LEAN_RATE] += by_torque * (per[0] * per[0]) + n.roll_noise * go;
    const double both = by_torque * (per[0] * per[1]);
    p[LEAN_RATE][STEER_RATE] += both;
    p[STEER_RATE][LEAN_RATE] += both;
    p[STEER_RATE][STEER_RATE] += by_torque * (per[1] * per[1]);
    p[GUST][GUST] += n.gust_noise * go;
    p[SPEED][SPEED] += n.speed_noise * go;
    p[ROLL_BIAS][ROLL_BIAS] += n.gyro_walk * dt;
    p[YAW_BIAS][YAW_BIAS] += n.gyro_walk * dt;
    p[FORCE_BIAS][FORCE_BIAS] += n.force_walk * dt;
    p[OFFSET][OFFSET] += n.offset_walk * dt;
  }

  void spread_course(const double* state, double dt) const {
    const double go = dt * moving;
    double sine, cosine;
    sine_cosine_of_turn(state[HEADING], sine, cosine);
    const double way[3][3] = {{1.0, 0.0, 0.0},
                              {-(state[SPEED] * cosine) * dt, 1.0, 0.0},
                              {-(state[SPEED] * sine) * dt, 0.0, 1.0}};
    double before[3][3], half[3][3], turned[3][3], after[3][3];
    for (int i = 0; i < 9; ++i) before[i / 3][i % 3] = course[i / 3][i % 3];
    transposed(way, turned);
    product(way, before, half);
    product(half, turned, after);
    for (int i = 0; i < 9; ++i) course[i / 3][i % 3] = after[i / 3][i % 3];
    const double turn = p[YAW_BIAS][YAW_BIAS] + n.course_noise;
    const double along = p[SPEED][SPEED] * 0.1 + 1e-4;
    course[0][0] += turn * go;
    course[1][1] += along * go;
    course[2][2] += along * go;
  }

  void roll_turn(const double* then, const Rates& found, double& value, double* slopes,
                 double& noise) const {
    const double lean = then[LEAN], steer = then[STEER];
    const double pitch = (all.pitch[0] * steer) * steer + (all.pitch[1] * steer) * lean +
                         (all.pitch[2] * lean) * lean;
    const double felt = (pitch * moving) * found.yaw * found.cosine;
    slopes[LEAN_RATE] = -1.0;
    slopes[ROLL_BIAS] = 1.0;
    value = felt - then[LEAN_RATE] + then[ROLL_BIAS];
    noise = n.turn_noise;
  }

  void yaw_turn(const double* then, const Axes& axes, const Rates& found, double& value,
                double* slopes, double& noise) const {
    const double yaw = found.yaw * moving;
    slopes[STEER] = axes[2][2] * moving * (1.0 + found.tangent * found.tangent);
    slopes[STEER_RATE] = axes[2][3] * moving;
    const double speed = then[SPEED];
    slopes[SPEED] = yaw * found.cosine / (speed < SLOWEST ? SLOWEST : speed);
    slopes[YAW_BIAS] = 1.0;
    const double loose = TURN_SHARE * yaw;
    noise = n.turn_noise + (n.turn_model + loose * loose) * moving;
    value = found.cosine * yaw + then[YAW_BIAS];
  }

  void side_force(const double* then, const Axes& axes, const Rates& found, double& value,
                  double* slopes, double& noise) const {
    const double speed = then[SPEED], yaw = found.yaw * moving;
    const double rolls = found.lean * moving, steers = found.steer * moving;
    const double steer_turn = axes[2][2], rate_turn = axes[2][3];
    const double turn_up = (steer_turn * then[STEER_RATE] + rate_turn * steers) * moving;
    value = (speed - n.height * yaw * found.sine) * yaw * found.cosine;
    value = value - GRAVITY * found.sine;
    value = value + n.height * rolls;
    value = value + n.ahead * turn_up;
    value = value + then[FORCE_BIAS];
    const double lever = n.height * moving, swing = n.ahead * rate_turn * moving;
    double by_accelerations[4];
    for (int axis = 0; axis < 4; ++axis)
      by_accelerations[axis] = lever * axes[0][axis] + swing * axes[1][axis];
    slopes[LEAN] = by_accelerations[0] - GRAVITY * found.cosine;
    slopes[LEAN_RATE] = by_accelerations[1];
    slopes[STEER] = by_accelerations[2] + speed * steer_turn * moving;
    slopes[STEER_RATE] =
        by_accelerations[3] + (speed * rate_turn + n.ahead * steer_turn) * moving;
    slopes[GUST] = by_accelerations[0];
    slopes[SPEED] = 2.0 * yaw;
    slopes[FORCE_BIAS] = 1.0;
    noise = n.force_noise + n.force_model * moving;
  }

  void correct(double* state, double error, const double* slopes, double noise, bool has,
               double gate, double* change) const {
    double reach[STATES];
    for (int i = 0; i < STATES; ++i) {
      reach[i] = p[i][0] * slopes[0];
      for (int k = 1; k < STATES; ++k) reach[i] = reach[i] + p[i][k] * slopes[k];
    }
    double total = noise + slopes[0] * reach[0];
    for (int k = 1; k < STATES; ++k) total = total + slopes[k] * reach[k];
    const bool believed = has && error * error < gate * gate * total;
    const double inverse = (believed ? 1.0 : 0.0) / total, gained = error * inverse;
    for (int i = 0; i < WIDTH; ++i) change[i] = i < STATES ? reach[i] * gained : 0.0;
    for (int i = 0; i < STATES; ++i) state[i] += change[i];
    for (int i = 0; i < STATES; ++i)
      for (int j = 0; j < STATES; ++j) p[i][j] -= reach[i] * (reach[j] * inverse);
  }
};

}  // namespace

extern "C" {

#define NAME(name) #name " "
const char* estimator_layout() { return NUMBERS(NAME); }
#undef NAME

void estimator_rates(const Bicycles* all, const double* state, double* rates) {
  for (long i = 0; i < all->count; ++i, state += WIDTH, rates += 3) {
    const One one(*all, i);
    Axes axes;
    one.axes(state, axes);
    const Rates found = one.rates(axes, state, STEP);
    rates[0] = found.lean;
    rates[1] = found.steer;
    rates[2] = found.yaw;
  }
}

void estimator_move(const Bicycles* all, double* state, double dt) {
  for (long i = 0; i < all->count; ++i) One(*all, i).move(state + i * WIDTH, dt);
}

void estimator_predict(const Bicycles* all, double dt) {
  for (long i = 0; i < all->count; ++i) {
    const One one(*all, i);
    double* state = all->state + i * WIDTH;
    Axes axes;
    one.axes(state, axes);
    one.spread(axes, dt);
    one.move(state, dt);
    one.spread_course(state, dt);
  }
}

void estimator_expected(const Bicycles* all, int what, const double* then, double* value,
                        double* slopes, double* noise) {
  for (long i = 0; i < all->count; ++i, then += WIDTH, slopes += STATES) {
    const One one(*all, i);
    Axes axes;
    one.axes(then, axes);
    const Rates found = one.rates(axes, then, STEP);
    for (int k = 0; k < STATES; ++k) slopes[k] = 0.0;
    if (what == ROLL_TURN) one.roll_turn(then, found, value[i], slopes, noise[i]);
    else if (what == YAW_TURN) one.yaw_turn(then, axes, found, value[i], slopes, noise[i]);
    else one.side_force(then, axes, found, value[i], slopes, noise[i]);
  }
}

void estimator_correct(const Bicycles* all, const double* error, const double* slopes,
                       const double* noise, const unsigned char* mask, double gate,
                       double* change) {
  for (long i = 0; i < all->count; ++i)
    One(*all, i).correct(all->state + i * WIDTH, error[i], slopes + i * STATES, noise[i],
                         mask[i] != 0, gate, change + i * WIDTH);
}

}  // extern "C"
