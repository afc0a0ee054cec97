#!/usr/bin/env bash
# Sets everything up as ride.sh does, then checks: ruff, mypy, all tests.
#
# Usage: tests/run.sh [PYTEST-ARGUMENT]...      such as -k goals, or -m "not ros"
#
# The browser tests need Chromium (sudo apt-get install -y chromium); without it they are skipped, with
# a line before and after, unless CI is set. Their pictures of the cockpit go to ros2_ws/runs/screenshots.
#
# Exit status: 0 all passed, else that of the first check that failed.
set -euo pipefail
root=$(CDPATH='' builtin cd -P "$(dirname "${BASH_SOURCE[0]}")/.." && builtin pwd)

case ${1:-} in
  -h | --help)
    sed -n '2,/^[^#]/{s/^# \{0,1\}//p}' "${BASH_SOURCE[0]}"
    exit 0
    ;;
esac

# Hundreds of programs start below; each would compile torch's thousand modules anew.
unset PYTHONDONTWRITEBYTECODE
"$root/ros2_ws/setup.sh" --with dev --quiet
# shellcheck source-path=SCRIPTDIR source=../ros2_ws/env.sh
. "$root/ros2_ws/env.sh"
cd "$root"

# A wrong type in a message field is an error in tests instead of a silently wrong number.
export ROS_PYTHON_CHECK_FIELDS=1
packages=(-p bicycle_common -p bicycle_sim -p bicycle_controller -p bicycle_bag -p bicycle_tools -p bicycle_bringup -p bicycle_cockpit -p bicycle_hardware)

echo "== ruff check" && ruff check --quiet .
echo "== ruff format" && ruff format --check --quiet .
echo "== mypy" && mypy "${packages[@]}" && mypy tests docker
chromium=yes
command -v chromium >/dev/null || command -v chromium-browser >/dev/null || chromium=
without="== no Chromium: the cockpit's browser tests are skipped; sudo apt-get install -y chromium"
[[ -n $chromium ]] || echo "$without"
# pytest's own variables could select other tests; a proxy would stand between tests and servers here.
unset PYTEST_ADDOPTS PYTEST_PLUGINS PYTEST_DISABLE_PLUGIN_AUTOLOAD MYPYPATH
export no_proxy=${no_proxy:+$no_proxy,}127.0.0.1,localhost
export NO_PROXY=$no_proxy
echo "== pytest"
# Two workers a processor, for nodes wait for one another most of the time. Whole files to one worker,
# so that a module's nodes and bags are made once.
workers=$((2 * $(env -u OMP_NUM_THREADS nproc)))
((workers <= 8)) || workers=8
status=0
# A run under nohup ignores SIGHUP, and so would every program that a test starts.
env --default-signal=HUP python -m pytest -n $workers --dist loadfile --no-loadscope-reorder -q "$@" || status=$?
[[ -n $chromium ]] || echo "$without"
exit "$status"
