// One control period of many Whipple bicycles: integrate.py, compiled.
//
// Products are rounded before they are added (-ffp-contract=off) and there is no function of a C
// library but the square root, which is exact. So all processors, all vector widths and Python
// give the same bits.

#include <cmath>

#include "compiler.h"

#define CONSTANTS(ROW)                                                                          \
  ROW(gravity) ROW(tilt) ROW(rear_radius) ROW(front_radius) ROW(rear_curvature)                 \
  ROW(front_curvature) ROW(axis_forward) ROW(axis_down) ROW(fork_offset) ROW(rear_mass)         \
  ROW(rear_rotor) ROW(rear_x) ROW(rear_z) ROW(rear_xx) ROW(rear_yy) ROW(rear_zz) ROW(rear_xz)   \
  ROW(front_mass) ROW(front_rotor) ROW(front_x) ROW(front_z) ROW(front_xx) ROW(front_yy)        \
  ROW(front_zz) ROW(front_xz) ROW(turn_limit) ROW(friction) ROW(stiction) ROW(damping)          \
  ROW(stop) ROW(motor_limit) ROW(motor_share) ROW(motor_change) ROW(motor_dead)                 \
  ROW(motor_instant) ROW(delay_share) ROW(gear) ROW(power) ROW(brake) ROW(governor) ROW(drag)   \
  ROW(side_drag) ROW(pressure_forward) ROW(pressure_down) ROW(rear_rolling) ROW(front_rolling)  \
  ROW(gravity_x) ROW(gravity_y) ROW(rider_mass) ROW(rider_x) ROW(rider_z) ROW(rider_down)       \
  ROW(rider_xx) ROW(rider_yy) ROW(rider_zz) ROW(rider_xz) ROW(tilt_sine) ROW(tilt_cosine)       \
  ROW(passive_stiffness) ROW(passive_damping) ROW(muscle_stiffness) ROW(muscle_damping)         \
  ROW(muscle_weight) ROW(muscle_limit) ROW(muscle_gain)

// The first MOVING of them are integrated, the last two of these only with a leaning rider.
#define STATES(ROW)                                                                             \
  ROW(lean_angle) ROW(lean_rate) ROW(steer_angle) ROW(steer_rate) ROW(heading) ROW(rear_x)      \
  ROW(rear_y) ROW(speed) ROW(pitch) ROW(rear_wheel_angle) ROW(front_wheel_angle)                \
  ROW(rider_lean) ROW(rider_rate) ROW(motor_torque) ROW(stopped) ROW(front_x) ROW(front_y)      \
  ROW(yaw_rate)

#define INPUTS(ROW)                                                                             \
  ROW(torque_before) ROW(torque) ROW(pedal_before) ROW(pedal) ROW(displacement_before)          \
  ROW(displacement) ROW(speed_low) ROW(speed_high) ROW(force_across) ROW(torque_x)              \
  ROW(torque_z) ROW(wind_x) ROW(wind_y)

namespace {

constexpr int MOVING = 13, WITHOUT_RIDER = 11;
enum { LEAN_RATE = 1, STEER_RATE = 3, SPEED = 7, RIDER_RATE = 12 };  // rows of a state
constexpr double PI = 3.141592653589793, UNLIMITED = 1e30, LIES = 1.3;

#define ONE(name) +1
constexpr int CONSTANT_ROWS = 0 CONSTANTS(ONE), STATE_ROWS = 0 STATES(ONE);
constexpr int INPUT_ROWS = 0 INPUTS(ONE);

struct Task {
  const double* constants;      // CONSTANT_ROWS rows of one bicycle for all, or of `count`
  long different;               // how many bicycles they describe: 1 or `count`
  double* state;                // STATE_ROWS rows of `count`, changed in place
  const double* const* inputs;  // INPUT_ROWS rows, of `count` or of one for all bicycles
  const long* lengths;          // of each of these rows: `count` or 1
  long count;
  int substeps, first, last;
  double time_step;
};

#define LANES 2
namespace narrow {
#include "whipple_lanes.h"
}
#undef LANES

#if defined(__x86_64__) && !defined(__clang__)
#define WIDER
#pragma GCC push_options
#pragma GCC target("avx2")
#define LANES 4
namespace wide {
#include "whipple_lanes.h"
}
#undef LANES
#pragma GCC pop_options

#pragma GCC push_options
#pragma GCC target("avx512f")
#define LANES 8
namespace widest {
#include "whipple_lanes.h"
}
#undef LANES
#pragma GCC pop_options
#endif

}  // namespace

extern "C" {

// The widest instructions there are here: 2 for AVX-512, 1 for AVX2, 0 for neither.
int whipple_width() {
#ifdef WIDER
  __builtin_cpu_init();
  if (__builtin_cpu_supports("avx512f")) return 2;
  if (__builtin_cpu_supports("avx2")) return 1;
#endif
  return 0;
}

// Names of all rows, by which Python knows that this was built from the same sources.
const char* whipple_rows() {
#define NAME(name) #name " "
  return CONSTANTS(NAME) "/ " STATES(NAME) "/ " INPUTS(NAME);
}

void whipple_advance(const double* constants, long different, double* state,
                     const double* const* inputs, const long* lengths, long count, int substeps,
                     double time_step, int first, int last, int extras, int rider, int width) {
  const Task task = {constants, different, state, inputs,    lengths,
                     count,     substeps,  first, last, time_step};
#ifdef WIDER
  if (width == 2) return widest::any(task, extras, rider);
  if (width == 1) return wide::any(task, extras, rider);
#endif
  narrow::any(task, extras, rider);
}

}  // extern "C"
