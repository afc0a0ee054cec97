// Drives a BoardLink by lines of text: for tests/hardware/test_board_link.py.
#include <cstdio>
#include <iostream>
#include <sstream>
#include <stdexcept>
#include <string>

#include "bicycle_ros2_control/board_link.hpp"

int main(int count, char ** words) {
  bicycle_ros2_control::BoardLink link;
  try {
    link.open(count > 1 ? words[1] : "", count > 2 ? std::stoul(words[2]) : 921600u);
  } catch (const std::runtime_error & error) {
    std::cerr << error.what() << std::endl;
    return 2;
  }
  for (std::string line; std::getline(std::cin, line);) {
    std::istringstream words_of(line);
    std::string verb;
    double a = 0.0, b = 0.0;
    words_of >> verb >> a >> b;
    bool good = true;
    if (verb == "command") {
      good = link.command(a, b, 100);
    } else if (verb == "arm") {
      good = link.arm(a > 0.5);
    } else if (verb == "stop") {
      good = link.stop();
    } else {
      good = link.receive();
    }
    const auto & r = link.readings();
    std::printf(
      "{\"good\": %s, \"gyro\": [%.9g, %.9g, %.9g], \"force\": [%.9g, %.9g, %.9g], \"steer\": %.9g, "
      "\"steer_rate\": %.9g, \"wheel\": %.9g, \"mode\": %d, \"reasons\": %d, \"torque\": %.9g, "
      "\"drive\": %.9g, \"battery\": %.9g, \"periods\": %u, \"bad_frames\": %u, \"damaged\": %u}\n",
      good ? "true" : "false", r.gyro[0], r.gyro[1], r.gyro[2], r.force[0], r.force[1], r.force[2],
      r.steer, r.steer_rate, r.wheel, r.mode, r.reasons, r.torque, r.drive, r.battery, r.periods,
      r.bad_frames, r.damaged);
    std::fflush(stdout);
  }
  return 0;
}
