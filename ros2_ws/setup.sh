#!/usr/bin/env bash
# Makes this clone ready to ride: virtual environment, locked Python packages, colcon build.
#
# Usage: setup.sh [--with train|foxglove|sbom|dev|bench]... [--cpp] [--force] [--quiet]
#
#   --with train      also what training needs: torch, Ray, Gymnasium, TensorBoard, ONNX
#   --with foxglove   also Foxglove's WebSocket server, for foxglove.sh
#   --with sbom       also what sbom.sh lists all packages with
#   --with dev        also what tests and checks need (holds train, foxglove and sbom)
#   --with bench      also sb3-contrib and SBX, which tests/benchmarks compares with (holds train)
#   --cpp             build the messages for C++, too, from now on; --force without it ends that
#   --force           do every stage again, done or not
#   --quiet           say nothing when there is nothing to do
#
# A stage that is done is skipped, so a second call takes a moment. The full log is ros2_ws/log/setup.log.
# PYTHON=/path/to/python chooses the interpreter (3.10 to 3.13). torch comes from PyPI; for a smaller one
# without CUDA set PIP_EXTRA_INDEX_URL=https://download.pytorch.org/whl/cpu (Python 3.11 to 3.13).
# Every package is checked against the SHA-256 in requirements/*.lock, which requirements/lock.sh makes
# again after a change of requirements/*.in.
# Where ROS 2 Jazzy is sourced from /opt/ros/jazzy, that is used: nothing is installed, only built.
# Exit status: 0 ready, 1 a stage failed, 2 bad arguments, 3 something is missing on this machine.
set -euo pipefail

ws=$(CDPATH='' builtin cd -P "$(dirname "$(readlink -f "${BASH_SOURCE[0]}")")" && builtin pwd)
# shellcheck source-path=SCRIPTDIR source=lib/common.sh
. "$ws/lib/common.sh"
# shellcheck source-path=SCRIPTDIR source=lib/shell.sh
. "$ws/lib/shell.sh"
# shellcheck source-path=SCRIPTDIR source=lib/stages.sh
. "$ws/lib/stages.sh"
# shellcheck source-path=SCRIPTDIR source=lib/packages.sh
. "$ws/lib/packages.sh"
# shellcheck source-path=SCRIPTDIR source=lib/build.sh
. "$ws/lib/build.sh"

venv=$(dirname "$ws")/.venv
stamps=$venv/.bicycle
sets=(build ride)
force=
quiet=
cpp=

while (($#)); do
  case $1 in
    --with)
      case ${2:-} in
        train | foxglove | sbom | dev | bench) sets+=("$2") ;;
        *) die 2 "--with takes train, foxglove, sbom, dev or bench, not '${2:-}'." ;;
      esac
      shift
      ;;
    --cpp) cpp=yes ;;
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

# Another environment's traces, which env.sh would make anew, would put its libraries into this one; the
# wheels' start-up hook believes its guard variable.
unset _ROS_WHEELS_BOOTSTRAP_COMPLETE LD_LIBRARY_PATH PYTHONPATH VIRTUAL_ENV
_bicycle_set_aside build "$(dirname "$ws")" "$venv"
aside=$_bicycle_aside # said by the first stage that has something to do

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

check_path
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

[[ -n $force || ! -f $ws/install/.bicycle.cpp ]] || cpp=yes # asked for before
inputs=$(build_inputs)
due=
is_done "$ws/install/.bicycle.stamp" "$inputs" || due=yes
beside=() # the set that is installed while the workspace is built: the last
if [[ -z $native ]]; then
  for set in "${sets[@]}"; do
    mapfile -t files < <(locks "$set" | sed "s|.*|requirements/&.lock|")
    packages=$(cd "$ws" && fingerprint "${files[@]}" "$venv/pyvenv.cfg")
    ! is_done "$stamps/$set.stamp" "$packages" || continue
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
  [[ -z $cpp ]] || : >"$ws/install/.bicycle.cpp"
  build "${beside[@]}"
  mark "$ws/install/.bicycle.stamp" "$inputs"
  ((${#beside[@]} == 0)) || mark "$stamps/${beside[0]}.stamp" "$packages"
fi
((stages)) || [[ -n $quiet ]] || echo "Set-up is complete; nothing to do."
