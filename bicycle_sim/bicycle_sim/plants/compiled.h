// What a plant's compiled step is made of: rows of bicycles, and numpy's own inner loops.
//
// A step gives the same bits as the plant's numpy code: every operation stands in its order, none
// is contracted, and what IEEE 754 leaves open (sine, arc tangent, the sign of a zero that a
// maximum returns) is left to numpy's loops.
#pragma once

#include <cstdint>

#include "compiler.h"

extern "C" {

struct Loop {  // of a ufunc, for doubles
  void (*call)(char** arrays, const intptr_t* count, const intptr_t* strides, void* data);
  void* data;
};

struct Loops {
  Loop sin, cos, arctan, arcsin, arctan2, maximum, minimum;
};

struct SpeedLimits {
  double low, high;
  int64_t given;
};

}  // extern "C"

namespace {

constexpr long BLOCK = 128;  // bicycles whose numbers stay in the first cache together

// The rows of a state, in the order of BodyState's fields.
enum { LEAN, LEAN_RATE, LEAN_ACCELERATION, STEER, STEER_RATE, HEADING, FRONT_X, FRONT_Y, REAR_X, REAR_Y, SPEED, STATES };

struct alignas(64) Row {
  double at[BLOCK];
};

struct Block {  // up to BLOCK bicycles in one period
  const Loops& loops;
  const SpeedLimits& limits;
  const double* state;  // before it: the first bicycle of rows of `all`
  const long all, n;
  Row torque, displacement, pedal;  // what is asked of them
  Row next[STATES];                 // after it
  Row p, q, r, s;                   // for values in between

  Block(const Loops& loops, const SpeedLimits& limits, const double* state, long all, long n)
      : loops(loops), limits(limits), state(state), all(all), n(n) {}

  const double* old(int row) const { return state + row * all; }
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

}  // namespace
