"""A checkout below a folder of any name: it builds, or setup.sh says at once that it cannot."""

from __future__ import annotations

import os
import shutil
import subprocess
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
WORKSPACE = ROOT / "ros2_ws"

REFUSED = ["a:b", "a;b", "cash$HOME", "`tick`", 'a"b', "{brace}", "new\nline", "tab\there"]
NOT_UTF_8 = os.fsdecode(b"lat\xefn")
BUILT = (
    "für 日本 🚲",
    "-o'neil (p) *[x] #%& ~!=,@+ back\\slash",
    "/".join(["long" * 30] * 2),
)
PYTHON_PACKAGE = """<?xml version="1.0"?>
<package format="3">
  <name>bicycle_sim</name><version>0.0.1</version><description>One module</description>
  <maintainer email="nobody@example.com">nobody</maintainer><license>Apache-2.0</license>
  <depend>bicycle_msgs</depend><export><build_type>ament_python</build_type></export>
</package>
"""
CMAKE = """cmake_minimum_required(VERSION 3.16)
project(bicycle_msgs)
find_package(ament_cmake REQUIRED)
find_package(rosidl_default_generators REQUIRED)
list(FILTER AMENT_EXTENSIONS_rosidl_generate_idl_interfaces EXCLUDE REGEX "cpp")
rosidl_generate_interfaces(${PROJECT_NAME} msg/One.msg)
ament_package()
"""
SETUP = """from setuptools import setup
setup(name="bicycle_sim", version="0.0.1", packages=["bicycle_sim"],
      data_files=[("share/ament_index/resource_index/packages", ["resource/bicycle_sim"]),
                  ("share/bicycle_sim", ["package.xml"])])
"""


def clone(folder: Path) -> Path:
    """Return a workspace of scripts, one message and one Python package; nothing is set up."""
    workspace = folder / "ros2_ws"
    messages, python = workspace / "src" / "bicycle_msgs", workspace / "src" / "bicycle_sim"
    (messages / "msg").mkdir(parents=True)
    (messages / "msg" / "One.msg").write_text("float64 value\n")
    (messages / "CMakeLists.txt").write_text(CMAKE)
    shutil.copy(ROOT / "bicycle_msgs" / "package.xml", messages)
    shutil.copytree(WORKSPACE / "src" / "tf2_msgs", workspace / "src" / "tf2_msgs")
    shutil.copytree(ROOT / "bicycle_msgs" / "cmake", messages / "cmake")
    for name in ("bicycle_sim", "resource"):
        (python / name).mkdir(parents=True)
    (python / "resource" / "bicycle_sim").touch()
    (python / "bicycle_sim" / "__init__.py").touch()
    (python / "setup.py").write_text(SETUP)
    (python / "package.xml").write_text(PYTHON_PACKAGE)
    for name in ("env.sh", "setup.sh", "fastdds_local.xml"):
        shutil.copy(WORKSPACE / name, workspace)
    for name in ("lib", "requirements"):
        (workspace / name).symlink_to(WORKSPACE / name)
    return workspace


@pytest.mark.parametrize("name", [*REFUSED, NOT_UTF_8])
def test_a_path_that_ros_cannot_take_is_refused_in_one_line(tmp_path: Path, name: str) -> None:
    workspace = clone(tmp_path / name)
    done = subprocess.run(
        [workspace / "setup.sh"], capture_output=True, text=True, env={"PATH": "/usr/bin:/bin"}
    )
    assert (done.returncode, done.stdout) == (3, "")
    (line,) = done.stderr.splitlines()
    remedy = (
        "is not UTF-8" if name == NOT_UTF_8 else "holds a character that ROS's tools cannot take"
    )
    assert remedy in line
    assert line.endswith("rename or move the folder.")
    assert not (workspace / "build").exists()


def test_a_workspace_below_any_other_name_builds(tmp_path: Path) -> None:
    workspace = clone(tmp_path.joinpath(*BUILT))
    (workspace.parent / ".venv").symlink_to(ROOT / ".venv")
    script = """
      set -euo pipefail
      ws=$PWD venv=$PWD/../.venv log=$PWD/build.log native='' aside=''
      . lib/common.sh; . lib/stages.sh; . lib/build.sh
      make_folders
      build
      . ./env.sh
      cd /
      python -c 'import bicycle_sim; from bicycle_msgs.msg import One; print(One(value=2.5).value)'
    """
    folders = {"TMPDIR": str(tmp_path), "HOME": str(tmp_path)}
    done = subprocess.run(
        ["bash", "-c", script],
        cwd=workspace,
        env={"PATH": "/usr/local/bin:/usr/bin:/bin", **folders},
        capture_output=True,
        text=True,
        errors="surrogateescape",
    )
    log = workspace / "build.log"
    assert done.returncode == 0, done.stderr + (log.read_text()[-2000:] if log.exists() else "")
    assert done.stdout.endswith("2.5\n")
    assert list(tmp_path.glob("bicycle-build*")) == []


def test_a_symbolic_link_in_the_path_is_followed(tmp_path: Path) -> None:
    (tmp_path / "way:in").symlink_to(ROOT)
    script = f". '{tmp_path}/way:in/ros2_ws/env.sh' && echo $BICYCLE_WS"
    done = subprocess.run(["bash", "-c", script], capture_output=True, text=True)
    assert done.stdout == f"{WORKSPACE}\n"
