#!/usr/bin/env bash
# Makes this clone ready to ride: virtual environment, locked Python packages, colcon build.
#
# Usage: setup.sh [--with train|foxglove|dev|bench]... [--force] [--quiet]
#
#   --with train      also what training needs: torch, Ray, Gymnasium, TensorBoard, ONNX
#   --with foxglove   also Foxglove's WebSocket server, for foxglove.sh
#   --with dev        also what tests and checks need (holds train and foxglove)
#   --with bench      also stable-baselines3, which tests/benchmarks compares with (holds train)
#   --force           do every stage again, done or not
#   --quiet           say nothing when there is nothing to do
#
# A stage that is done is skipped, so a second call takes a moment. The full log is ros2_ws/log/setup.log.
# PYTHON=/path/to/python chooses the interpreter (3.10 to 3.13). torch comes from PyPI; for a smaller one
# without CUDA set PIP_EXTRA_INDEX_URL=https://download.pytorch.org/whl/cpu.
# requirements/lock.sh makes the locks again after a change of requirements/*.in.
# Where ROS 2 Jazzy is sourced from /opt/ros/jazzy, that is used: nothing is installed, only built.
# Exit status: 0 ready, 1 a stage failed, 2 bad arguments, 3 something is missing on this machine.
set -euo pipefail

ws=$(cd -P "$(dirname "${BASH_SOURCE[0]}")" && pwd)
# shellcheck source-path=SCRIPTDIR source=lib/common.sh
. "$ws/lib/common.sh"
# shellcheck source-path=SCRIPTDIR source=lib/stages.sh
. "$ws/lib/stages.sh"

# torch by itself, before any lock: its wheels differ by machine (CPU, each CUDA with its own
# libraries), so a universal lock would force one machine's choice on all.
torch=torch==2.13.0
uv=uv==0.9.30
venv=$(dirname "$ws")/.venv
stamps=$venv/.bicycle
sets=(build ride)
force=
quiet=

while (($#)); do
  case $1 in
    --with)
      case ${2:-} in
        train | foxglove | dev | bench) sets+=("$2") ;;
        *) die 2 "--with takes train, foxglove, dev or bench, not '${2:-}'." ;;
      esac
      shift
      ;;
    --force) force=yes ;;
    --quiet) quiet=yes ;;
    -h | --help) usage "${BASH_SOURCE[0]}" && exit 0 ;;
    *) die 2 "unknown option '$1'; see setup.sh --help." ;;
  esac
  shift
done

if [[ -f $ws/install/.bicycle.sealed ]]; then # by docker/seal.sh
  for set in "${sets[@]:1}"; do
    [[ -f $stamps/$set.stamp ]] || die 3 "this image was made without '$set'; build another target of docker/Dockerfile."
  done
  [[ -n $quiet ]] || echo "This is a sealed image; nothing to do."
  exit 0
fi

# Another environment's traces would put its libraries into this one (the wheels' start-up hook
# believes its guard variable), and pip's own variables could install somewhere else.
unset _ROS_WHEELS_BOOTSTRAP_COMPLETE LD_LIBRARY_PATH PYTHONPATH PYTHONHOME VIRTUAL_ENV \
  PIP_USER PIP_TARGET PIP_PREFIX COLCON_PREFIX_PATH

make_venv() { # Every step may be interrupted: what is half done is seen and done again
  if [[ -e $venv && ! -f $venv/pyvenv.cfg && ! -d $stamps && -n $(ls -A "$venv") ]]; then
    die 3 "$venv is in the way and is not a virtual environment; move it and call again."
  fi
  if [[ -f $stamps/venv.stamp ]] || { [[ -d $venv ]] && ! "$venv/bin/python" -c "" >/dev/null 2>&1; }; then
    rm -rf "$ws/build/old_venv"
    mv "$venv" "$ws/build/old_venv"
    stage "removing the old virtual environment" none rm -rf "$ws/build/old_venv"
  fi
  mkdir -p "$stamps"
  if [[ -x $venv/bin/python ]]; then
    echo "Using the virtual environment that is there: $venv"
  else
    [[ -n $python ]] || find_python || die 3 "no Python 3.10 to 3.13 to make it with; set PYTHON=/path/to/one."
    stage "virtual environment ($("$python" -V 2>&1))" none "$python" -m venv --without-pip "$venv"
  fi
}

install_torch_for() { # SET
  case $1 in train | dev | bench) stage "$torch" none install "$torch" ;; esac
}

install_set() { # SET: the packages of one lock
  stage "Python packages: $1" "pip:$(grep -c == "$ws/requirements/$1.lock")" install_lock "$1"
}

install_lock() { # SET: the locks are complete, so nobody need work out dependencies
  install --no-deps -r "$ws/requirements/$1.lock"
}

install() { # pip's words: with uv, which fetches many at once, or with pip where uv cannot
  local pip settings
  find_pip
  pip+=(install --no-input --disable-pip-version-check --progress-bar off)
  if settings=$("${pip[0]}" "$ws/lib/pip_to_uv.py") &&
    { [[ -x $venv/bin/uv ]] || "${pip[@]}" --only-binary :all: "$uv"; }; then
    mapfile -t settings <<<"$settings"
    env "${settings[@]}" "$venv/bin/uv" pip install --python "$venv/bin/python" "$@" && return
    echo "uv could not; now with pip."
  fi
  "${pip[@]}" "$@"
}

find_pip() { # Sets pip: the environment's, that of the Python it is made with, or a new one, which takes a while
  pip=("$venv/bin/python" -m pip)
  ! "${pip[@]}" --version || return 0
  pip=("$("$venv/bin/python" -c 'import sys; print(sys._base_executable)')" -m pip --python "$venv/bin/python")
  ! "${pip[@]}" --version || return 0
  "$venv/bin/python" -m ensurepip
  pip=("$venv/bin/python" -m pip)
}

build() { # [SET]: builds in place, so that Python packages run from their sources; installs SET meanwhile
  local options=(--base-paths src --symlink-install --event-handlers console_direct+ console_cohesion- status-)
  local cmake=(-DCMAKE_BUILD_TYPE=Release -DBUILD_TESTING=OFF)
  if [[ -z $native ]]; then
    export AMENT_PREFIX_PATH=$venv LD_LIBRARY_PATH=$venv/lib PATH=$venv/bin:$PATH VIRTUAL_ENV=$venv
    # The wheels hold no C++ program that could use the messages; for C++ they take half as long again.
    cmake+=(-G Ninja -DPYTHON_ONLY=ON "-DCMAKE_PREFIX_PATH=$venv" "-DPython3_EXECUTABLE=$venv/bin/python")
  fi
  # Generators and colcon's helpers start dozens of times: what they import need be compiled once.
  unset PYTHONDONTWRITEBYTECODE
  # Without it colcon adds -l: a busy machine would compile one file at a time.
  export MAKEFLAGS=${MAKEFLAGS:--j$(nproc)}
  local colcon=(colcon --log-base /dev/null build "${options[@]}" --cmake-args "${cmake[@]}")
  cd "$ws"
  if [[ -z ${1:-} ]]; then
    stage "building the workspace" cmake "${colcon[@]}"
  else
    stage "Python packages: $1, building the workspace" cmake beside "$1" "${colcon[@]}"
  fi
}

beside() { # SET COMMAND...: installs packages that the command does without, as it goes
  local set=$1 installing
  shift
  (unset AMENT_PREFIX_PATH LD_LIBRARY_PATH && install_lock "$set") >"$log.$set" 2>&1 &
  installing=$!
  "$@" || { kill "$installing" 2>/dev/null || true; return 1; }
  local status=0
  wait "$installing" || status=$?
  cat "$log.$set" && rm "$log.$set" # into the stage's own log, behind the command's
  return "$status"
}

make_folders
one_at_a_time
find_native
if [[ -n $native ]]; then
  check_native
  echo "ROS 2 Jazzy is sourced from /opt/ros/jazzy: using it, without a virtual environment."
  echo "Plain 'colcon build' in $ws does the same as this."
  [[ ${sets[-1]} == ride ]] || die 3 "--with installs into a virtual environment; not with a sourced ROS 2. Open a fresh shell."
else
  check_system
  is_done "$stamps/venv.stamp" "$venv" || { make_venv && mark "$stamps/venv.stamp" "$venv"; }
  ln -sfn ../../ros2_ws/bin/bicycle "$venv/bin/bicycle"
fi

inputs=$(build_inputs)
due=
is_done "$ws/install/.bicycle.stamp" "$inputs" || due=yes
beside=() # the set that is installed while the workspace is built: the last
if [[ -z $native ]]; then
  for set in "${sets[@]}"; do
    packages=$(fingerprint "$ws/requirements/$set.lock" "$venv/pyvenv.cfg")
    ! is_done "$stamps/$set.stamp" "$packages" || continue
    install_torch_for "$set"
    if [[ -n $due && $set == "${sets[-1]}" ]]; then
      beside=("$set")
    else
      install_set "$set" && mark "$stamps/$set.stamp" "$packages"
    fi
  done
fi
if [[ -n $due ]]; then
  clean_unless_same_python
  mark "$ws/install/.bicycle.stamp" building
  build "${beside[@]}"
  mark "$ws/install/.bicycle.stamp" "$inputs"
  ((${#beside[@]} == 0)) || mark "$stamps/${beside[0]}.stamp" "$packages"
fi
((stages)) || [[ -n $quiet ]] || echo "Set-up is complete; nothing to do."
