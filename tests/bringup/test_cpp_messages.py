"""Messages for C++, as `setup.sh --cpp` builds them: a program writes one and Python reads it."""

from __future__ import annotations

import shutil
import subprocess
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
WORKSPACE = ROOT / "ros2_ws"

BUILD = """
set -euo pipefail
ws=$PWD venv={venv} log=$PWD/build.log native='' aside='' cpp={cpp}
. {lib}/common.sh; . {lib}/stages.sh; . {lib}/build.sh
export AMENT_PREFIX_PATH=$venv LD_LIBRARY_PATH=$venv/lib PATH=$venv/bin:$PATH VIRTUAL_ENV=$venv
colcon_build "$venv" --base-paths src >build.log 2>&1
"""
PROGRAM = r"""
#include <cstdio>
#include <rmw/rmw.h>
#include <rosidl_typesupport_cpp/message_type_support.hpp>
#include <tf2_msgs/msg/tf_message.hpp>

int main(int, char ** words)
{
  using tf2_msgs::msg::TFMessage;
  TFMessage message;
  message.transforms.resize(1);
  message.transforms[0].child_frame_id = "base_link";
  message.transforms[0].transform.translation.x = 2.5;
  auto bytes = rmw_get_zero_initialized_serialized_message();
  auto allocator = rcutils_get_default_allocator();
  if (rmw_serialized_message_init(&bytes, 0, &allocator) != RMW_RET_OK) return 1;
  const auto * type = rosidl_typesupport_cpp::get_message_type_support_handle<TFMessage>();
  if (rmw_serialize(&message, type, &bytes) != RMW_RET_OK) return 2;
  FILE * file = std::fopen(words[1], "wb");
  std::fwrite(bytes.buffer, 1, bytes.buffer_length, file);
  return std::fclose(file);
}
"""
CMAKE = """cmake_minimum_required(VERSION 3.16)
project(writer CXX)
set(CMAKE_CXX_STANDARD 17)
find_package(tf2_msgs REQUIRED)
find_package(rmw REQUIRED)
find_library(middleware rmw_fastrtps_cpp REQUIRED)
add_executable(writer writer.cpp)
target_link_libraries(writer tf2_msgs::tf2_msgs__rosidl_typesupport_cpp rmw::rmw ${middleware})
# The wheels find the libraries that they need themselves when the program runs.
target_link_options(writer PRIVATE -Wl,--allow-shlib-undefined)
"""
READ = """
import sys
from pathlib import Path
from rclpy.serialization import deserialize_message
from tf2_msgs.msg import TFMessage
message = deserialize_message(Path(sys.argv[1]).read_bytes(), TFMessage)
print(message.transforms[0].child_frame_id, message.transforms[0].transform.translation.x)
"""

if not (ROOT / ".venv").is_dir():
    pytest.skip("a native ROS 2 builds the messages for C++ anyway", allow_module_level=True)


def run(script: str, folder: Path) -> str:
    """Return what a script prints in a clean environment."""
    done = subprocess.run(
        ["bash", "-c", script],
        cwd=folder,
        env={"PATH": "/usr/local/bin:/usr/bin:/bin", "HOME": str(folder)},
        capture_output=True,
        text=True,
    )
    logs = "".join(path.read_text()[-2000:] for path in folder.glob("*.log"))
    assert done.returncode == 0, done.stderr + done.stdout + logs
    return done.stdout


@pytest.mark.slow
def test_a_program_in_cpp_writes_what_python_reads(tmp_path: Path) -> None:
    (tmp_path / "src").mkdir()
    shutil.copytree((WORKSPACE / "src" / "tf2_msgs").resolve(), tmp_path / "src" / "tf2_msgs")
    shared = Path("bicycle_msgs") / "cmake"  # which both packages include
    shutil.copytree(ROOT / shared, tmp_path / "src" / shared)
    (tmp_path / "writer").mkdir()
    (tmp_path / "writer" / "writer.cpp").write_text(PROGRAM)
    (tmp_path / "writer" / "CMakeLists.txt").write_text(CMAKE)
    words = {"venv": (ROOT / ".venv").resolve(), "lib": WORKSPACE / "lib"}
    run(BUILD.format(**words, cpp="''"), tmp_path)
    headers = list(tmp_path.glob("install/tf2_msgs/include/**/*.hpp"))
    assert headers == [], "they cost time, and nobody asked for them"
    run(BUILD.format(**words, cpp="yes"), tmp_path)
    own = tmp_path / "install" / "tf2_msgs"
    program = f"""
      set -euo pipefail
      . {WORKSPACE}/env.sh
      cmake -S writer -B writer/build '-DCMAKE_PREFIX_PATH={words["venv"]};{own}' >cmake.log 2>&1
      cmake --build writer/build >compile.log 2>&1
      export LD_LIBRARY_PATH={own}/lib:$LD_LIBRARY_PATH
      export PYTHONPATH=$(echo {own}/lib/python3*/*-packages):$PYTHONPATH
      writer/build/writer message.cdr
      cat >read.py <<'PYTHON'\n{READ}\nPYTHON
      python read.py message.cdr
    """
    assert run(program, tmp_path).endswith("base_link 2.5\n")
