#include "bicycle_ros2_control/board_link.hpp"

#include <fcntl.h>
#include <termios.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstring>
#include <stdexcept>

extern "C" {
#include "bicycle_core.h"
}

namespace bicycle_ros2_control {
namespace {

constexpr std::size_t kLongest = 96;     // bytes between two zeros beyond which a frame is none
constexpr double kRateSeconds = 0.02;    // time constant of the steer rate

std::uint16_t get_u16(const std::uint8_t * b) {
  return static_cast<std::uint16_t>(b[0] | b[1] << 8);
}

std::uint32_t get_u32(const std::uint8_t * b) {
  return get_u16(b) | static_cast<std::uint32_t>(get_u16(b + 2)) << 16;
}

double get_f32(const std::uint8_t * b) {
  const std::uint32_t bits = get_u32(b);
  float value;
  std::memcpy(&value, &bits, sizeof value);
  return value;
}

void put_u16(std::vector<std::uint8_t> & to, std::uint16_t value) {
  to.push_back(static_cast<std::uint8_t>(value));
  to.push_back(static_cast<std::uint8_t>(value >> 8));
}

void put_u32(std::vector<std::uint8_t> & to, std::uint32_t value) {
  put_u16(to, static_cast<std::uint16_t>(value));
  put_u16(to, static_cast<std::uint16_t>(value >> 16));
}

void put_f32(std::vector<std::uint8_t> & to, double value) {
  const float narrow = static_cast<float>(value);
  std::uint32_t bits;
  std::memcpy(&bits, &narrow, sizeof bits);
  put_u32(to, bits);
}

// Consistent overhead byte stuffing (Cheshire and Baker 1999); frames are shorter than 254 bytes.
std::vector<std::uint8_t> stuffed(const std::vector<std::uint8_t> & plain) {
  std::vector<std::uint8_t> found{1};
  std::size_t code_at = 0;
  for (const std::uint8_t byte : plain) {
    if (byte != 0) {
      found.push_back(byte);
      ++found[code_at];
    } else {
      code_at = found.size();
      found.push_back(1);
    }
  }
  found.push_back(0);
  return found;
}

bool unstuffed(const std::vector<std::uint8_t> & bytes, std::vector<std::uint8_t> & plain) {
  plain.clear();
  std::size_t at = 0;
  while (at < bytes.size()) {
    const std::size_t code = bytes[at];
    if (code == 0 || at + code > bytes.size()) {
      return false;
    }
    plain.insert(plain.end(), bytes.begin() + at + 1, bytes.begin() + at + code);
    at += code;
    if (code < 0xFF && at < bytes.size()) {
      plain.push_back(0);
    }
  }
  return true;
}

speed_t line_speed(unsigned bits) {
  switch (bits) {
    case 115200: return B115200;
    case 230400: return B230400;
    case 460800: return B460800;
    case 921600: return B921600;
  }
  throw std::runtime_error(
    "a serial line has no " + std::to_string(bits) +
    " bits/s: choose one of 115200, 230400, 460800, 921600");
}

}  // namespace

BoardLink::~BoardLink() { close(); }

void BoardLink::open(const std::string & path, unsigned speed) {
  const speed_t bits = line_speed(speed);
  close();
  file_ = ::open(path.c_str(), O_RDWR | O_NOCTTY | O_NONBLOCK | O_CLOEXEC);
  if (file_ < 0) {
    throw std::runtime_error("cannot open " + path + ": " + std::strerror(errno));
  }
  termios settings{};
  if (tcgetattr(file_, &settings) != 0) {
    close();
    throw std::runtime_error(path + " is no serial line");
  }
  cfmakeraw(&settings);
  settings.c_cflag |= CREAD | CLOCAL;
  cfsetispeed(&settings, bits);
  cfsetospeed(&settings, bits);
  tcsetattr(file_, TCSANOW, &settings);
  tcflush(file_, TCIFLUSH);
  waiting_.clear();
  readings_ = Readings{};
}

void BoardLink::close() {
  if (file_ >= 0) {
    ::close(file_);
    file_ = -1;
  }
}

bool BoardLink::receive() {
  std::uint8_t some[512];
  while (file_ >= 0) {
    const ssize_t count = ::read(file_, some, sizeof some);
    if (count < 0 && errno == EINTR) {
      continue;
    }
    if (count < 0) {
      return errno == EAGAIN || errno == EWOULDBLOCK;
    }
    if (count == 0) {
      return true;
    }
    for (ssize_t i = 0; i < count; ++i) {
      if (some[i] != 0) {
        // One byte more than the longest frame is kept, so that it is seen to be too long.
        if (waiting_.size() <= kLongest) {
          waiting_.push_back(some[i]);
        }
        continue;
      }
      if (!waiting_.empty()) {
        take(waiting_);
        waiting_.clear();
      }
    }
  }
  return false;
}

void BoardLink::take(const std::vector<std::uint8_t> & bytes) {
  std::vector<std::uint8_t> plain;
  if (bytes.size() > kLongest || !unstuffed(bytes, plain) || plain.size() < 5 ||
      core_crc(plain.data(), plain.size() - 2) != get_u16(plain.data() + plain.size() - 2)) {
    ++readings_.damaged;
    return;
  }
  take_payload(plain[0], plain.data() + 3, plain.size() - 5);
}

void BoardLink::take_payload(std::uint8_t kind, const std::uint8_t * b, std::size_t count) {
  Readings & r = readings_;
  if (kind == CORE_IMU && count == 28) {
    r.imu_us = get_u32(b);
    for (std::size_t axis = 0; axis < 3; ++axis) {
      r.gyro[axis] = get_f32(b + 4 + 4 * axis);
      r.force[axis] = get_f32(b + 16 + 4 * axis);
    }
  } else if (kind == CORE_STEER && count == 12) {
    const std::uint32_t stamp = get_u32(b);
    const double angle = get_f32(b + 4);
    const double dt = 1e-6 * (stamp - r.steer_us);
    if (r.steer_us != 0 && dt > 0.0 && dt < 0.5) {
      r.steer_rate += ((angle - r.steer) / dt - r.steer_rate) * std::min(1.0, dt / kRateSeconds);
    } else {
      r.steer_rate = 0.0;
    }
    r.steer_us = stamp;
    r.steer = angle;
    r.steer_torque = get_f32(b + 8);
  } else if (kind == CORE_WHEEL && count == 8) {
    r.wheel_us = get_u32(b);
    r.wheel = get_f32(b + 4);
  } else if (kind == CORE_STATE && count == 26) {
    r.mode = b[4];
    r.reasons = b[5];
    r.torque = get_f32(b + 6);
    r.drive = get_f32(b + 10);
    r.battery = get_f32(b + 14);
    r.age_ms = get_u16(b + 20);
    r.bad_frames = get_u32(b + 22);
  } else if (kind == CORE_PERIOD && count == 19) {
    r.period_us = get_u32(b);
    r.mode = b[8];
    r.torque = get_f32(b + 9);
    r.drive = get_f32(b + 13);
    ++r.periods;
  } else if (kind != CORE_TIME_IS) {
    ++r.damaged;
  }
}

bool BoardLink::send(std::uint8_t kind, const std::vector<std::uint8_t> & payload) {
  std::vector<std::uint8_t> plain{kind};
  put_u16(plain, ++sequence_);
  plain.insert(plain.end(), payload.begin(), payload.end());
  put_u16(plain, core_crc(plain.data(), plain.size()));
  const std::vector<std::uint8_t> frame = stuffed(plain);
  // What the line does not take is lost, as on any wire: a later command makes it good.
  return file_ >= 0 &&
         ::write(file_, frame.data(), frame.size()) == static_cast<ssize_t>(frame.size());
}

bool BoardLink::command(double torque, double drive, std::uint16_t valid_ms) {
  std::vector<std::uint8_t> payload;
  put_u32(payload, readings_.period_us);
  put_f32(payload, torque);
  put_f32(payload, drive);
  put_u16(payload, valid_ms);
  return send(CORE_ACTUATORS, payload);
}

bool BoardLink::arm(bool wanted) {
  return send(CORE_ARM, {static_cast<std::uint8_t>(wanted ? 1 : 0)});
}

bool BoardLink::stop() { return send(CORE_STOP, {}); }

}  // namespace bicycle_ros2_control
