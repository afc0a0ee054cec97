// The bicycle as a ros2_control system: joints `steer` and `rear_wheel`, sensor `imu`, gpio `board`.
//
// It has not been compiled or run here, for there is no native ROS 2: all that it does with the
// line is in board_link.cpp, which the tests ride.
#include <cmath>
#include <limits>
#include <stdexcept>
#include <string>
#include <vector>

#include "bicycle_ros2_control/board_link.hpp"
#include "hardware_interface/handle.hpp"
#include "hardware_interface/hardware_info.hpp"
#include "hardware_interface/system_interface.hpp"
#include "hardware_interface/types/hardware_interface_return_values.hpp"
#include "pluginlib/class_list_macros.hpp"
#include "rclcpp/duration.hpp"
#include "rclcpp/logging.hpp"
#include "rclcpp/time.hpp"
#include "rclcpp_lifecycle/state.hpp"

namespace bicycle_ros2_control {

using hardware_interface::CallbackReturn;
using hardware_interface::CommandInterface;
using hardware_interface::StateInterface;

class BicycleSystem : public hardware_interface::SystemInterface {
public:
  CallbackReturn on_init(const hardware_interface::HardwareInfo & info) override {
    if (hardware_interface::SystemInterface::on_init(info) != CallbackReturn::SUCCESS) {
      return CallbackReturn::ERROR;
    }
    try {
      port_ = parameter("port", "/dev/ttyACM0");
      speed_ = static_cast<unsigned>(std::stoul(parameter("baud", "921600")));
      radius_ = std::stod(parameter("wheel_radius", "0.34"));
      valid_ms_ = static_cast<std::uint16_t>(std::stoul(parameter("valid_ms", "100")));
    } catch (const std::logic_error &) {
      return refused("baud, wheel_radius and valid_ms must be numbers");
    }
    if (!(radius_ > 0.05) || valid_ms_ < 1 || valid_ms_ > 200) {
      return refused("wheel_radius must be above 0.05 m and valid_ms within 1 and 200");
    }
    return CallbackReturn::SUCCESS;
  }

  std::vector<StateInterface> export_state_interfaces() override {
    std::vector<StateInterface> found;
    found.emplace_back("steer", "position", &steer_);
    found.emplace_back("steer", "velocity", &steer_rate_);
    found.emplace_back("steer", "effort", &steer_effort_);
    found.emplace_back("rear_wheel", "velocity", &wheel_rate_);
    found.emplace_back("rear_wheel", "effort", &wheel_effort_);
    static const char * const axes[] = {"x", "y", "z"};
    for (std::size_t axis = 0; axis < 3; ++axis) {
      found.emplace_back("imu", std::string("angular_velocity.") + axes[axis], &gyro_[axis]);
      found.emplace_back("imu", std::string("linear_acceleration.") + axes[axis], &force_[axis]);
    }
    for (std::size_t part = 0; part < 4; ++part) {  // the board estimates none
      found.emplace_back("imu", std::string("orientation.") + "xyzw"[part], &orientation_);
    }
    found.emplace_back("board", "mode", &mode_);
    found.emplace_back("board", "reasons", &reasons_);
    found.emplace_back("board", "battery", &battery_);
    found.emplace_back("board", "command_age", &age_);
    return found;
  }

  std::vector<CommandInterface> export_command_interfaces() override {
    std::vector<CommandInterface> found;
    found.emplace_back("steer", "effort", &torque_wanted_);
    found.emplace_back("rear_wheel", "effort", &wheel_wanted_);
    found.emplace_back("board", "arm", &arm_wanted_);
    return found;
  }

  CallbackReturn on_configure(const rclcpp_lifecycle::State &) override {
    try {
      link_.open(port_, speed_);
    } catch (const std::runtime_error & error) {
      return refused(error.what());
    }
    return CallbackReturn::SUCCESS;
  }

  CallbackReturn on_activate(const rclcpp_lifecycle::State &) override {
    torque_wanted_ = wheel_wanted_ = arm_wanted_ = 0.0;
    armed_ = false;
    return CallbackReturn::SUCCESS;
  }

  // The board then rides on by its own law, as when this process is killed.
  CallbackReturn on_deactivate(const rclcpp_lifecycle::State &) override {
    torque_wanted_ = wheel_wanted_ = 0.0;
    return CallbackReturn::SUCCESS;
  }

  CallbackReturn on_cleanup(const rclcpp_lifecycle::State &) override {
    link_.close();
    return CallbackReturn::SUCCESS;
  }

  hardware_interface::return_type read(const rclcpp::Time &, const rclcpp::Duration &) override {
    if (!link_.receive()) {
      return hardware_interface::return_type::ERROR;
    }
    const Readings & r = link_.readings();
    steer_ = r.steer;
    steer_rate_ = r.steer_rate;
    steer_effort_ = r.torque;
    wheel_rate_ = r.wheel / radius_;
    wheel_effort_ = r.drive * radius_;
    gyro_ = r.gyro;
    force_ = r.force;
    mode_ = r.mode;
    reasons_ = r.reasons;
    battery_ = r.battery;
    age_ = 1e-3 * r.age_ms;
    return hardware_interface::return_type::OK;
  }

  hardware_interface::return_type write(const rclcpp::Time &, const rclcpp::Duration &) override {
    const bool wanted = arm_wanted_ > 0.5;
    if (wanted != armed_) {
      link_.arm(wanted);
      armed_ = wanted;
    }
    // Without finite commands nothing is sent: the board notices and steers by itself.
    if (std::isfinite(torque_wanted_) && std::isfinite(wheel_wanted_)) {
      link_.command(torque_wanted_, wheel_wanted_ / radius_, valid_ms_);
    }
    return hardware_interface::return_type::OK;
  }

private:
  std::string parameter(const std::string & name, const std::string & otherwise) const {
    const auto found = info_.hardware_parameters.find(name);
    return found == info_.hardware_parameters.end() ? otherwise : found->second;
  }

  static CallbackReturn refused(const std::string & why) {
    RCLCPP_ERROR(rclcpp::get_logger("bicycle_ros2_control"), "%s", why.c_str());
    return CallbackReturn::ERROR;
  }

  BoardLink link_;
  std::string port_;
  unsigned speed_ = 0;
  double radius_ = 0.34;
  std::uint16_t valid_ms_ = 100;
  bool armed_ = false;
  double steer_ = 0.0, steer_rate_ = 0.0, steer_effort_ = 0.0, wheel_rate_ = 0.0, wheel_effort_ = 0.0;
  std::array<double, 3> gyro_{}, force_{};
  double orientation_ = std::numeric_limits<double>::quiet_NaN();
  double mode_ = 0.0, reasons_ = 0.0, battery_ = 0.0, age_ = 0.0;
  double torque_wanted_ = 0.0, wheel_wanted_ = 0.0, arm_wanted_ = 0.0;
};

}  // namespace bicycle_ros2_control

PLUGINLIB_EXPORT_CLASS(bicycle_ros2_control::BicycleSystem, hardware_interface::SystemInterface)
