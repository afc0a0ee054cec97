// The serial line to the bicycle's microcontroller, without ROS: what the ros2_control plugin reads
// and writes. Frames are those of bicycle_core.h; docs/wire.md has the table.
//
// Signs are REP-103: steering is positive to the left, gyro x is positive when rolling to the right.
#ifndef BICYCLE_ROS2_CONTROL__BOARD_LINK_HPP_
#define BICYCLE_ROS2_CONTROL__BOARD_LINK_HPP_

#include <array>
#include <cstddef>
#include <cstdint>
#include <string>
#include <vector>

namespace bicycle_ros2_control {

/// What the board told last; stamps are its clock's microseconds, 0 before the first.
struct Readings {
  std::uint32_t imu_us = 0, steer_us = 0, wheel_us = 0;
  std::array<double, 3> gyro{};   ///< rad/s
  std::array<double, 3> force{};  ///< m/s^2
  double steer = 0.0;             ///< rad
  double steer_rate = 0.0;        ///< rad/s, from the encoder's differences
  double steer_torque = 0.0;      ///< N m, as the motor reports it
  double wheel = 0.0;             ///< m/s at the rim
  std::uint8_t mode = 0;          ///< core_mode
  std::uint8_t reasons = 0;       ///< core_reason, why arming is refused
  double torque = 0.0;            ///< N m, applied
  double drive = 0.0;             ///< N at the rim, applied
  double battery = 0.0;           ///< V
  std::uint16_t age_ms = 0;       ///< of the command that is obeyed
  std::uint32_t bad_frames = 0;   ///< that the board did not take
  std::uint32_t period_us = 0;    ///< stamp of the last control period
  std::uint32_t periods = 0;      ///< control periods that have ended here
  std::uint32_t damaged = 0;      ///< frames that this side did not take
};

class BoardLink {
public:
  BoardLink() = default;
  ~BoardLink();
  BoardLink(const BoardLink &) = delete;
  BoardLink & operator=(const BoardLink &) = delete;

  /// Open a line at so many bits/s, raw and without waiting.
  /// Throws std::runtime_error, in one line.
  void open(const std::string & path, unsigned speed);
  void close();
  bool is_open() const { return file_ >= 0; }

  /// Take what has come. False if the line is broken.
  bool receive();
  /// Send a command that answers the last period; the board obeys it for `valid_ms` at most.
  bool command(double torque, double drive, std::uint16_t valid_ms);
  bool arm(bool wanted);
  bool stop();

  const Readings & readings() const { return readings_; }

private:
  bool send(std::uint8_t kind, const std::vector<std::uint8_t> & payload);
  void take(const std::vector<std::uint8_t> & stuffed);
  void take_payload(std::uint8_t kind, const std::uint8_t * bytes, std::size_t count);

  int file_ = -1;
  std::uint16_t sequence_ = 0;
  std::vector<std::uint8_t> waiting_;
  Readings readings_;
};

}  // namespace bicycle_ros2_control

#endif  // BICYCLE_ROS2_CONTROL__BOARD_LINK_HPP_
