#!/usr/bin/env bash
# Sends the bicycle to a goal, or to each point of a file in order.
#
# Usage: goal.sh X Y [--yaw DEG] [--wait] [--timeout S] [__ns:=/name]
#        goal.sh --file waypoints.yaml|waypoints.csv [--wait] [--timeout S] [__ns:=/name]
#
#   X Y           metres in the odom frame; the same as a 2D Goal Pose from RViz or Foxglove
#   --yaw DEG     direction of arrival, degrees counter-clockwise from +x; any unless named
#   --file FILE   points to ride to one after the other: YAML (a list of [x, y]) or CSV (x,y a line)
#   --wait        stay until the last goal is decided, with distance left, speed and lean
#   --timeout S   seconds to wait for the controller to accept, and with --wait for each goal
#   __ns:=/name   the bicycle's namespace, where it has one
#
# To a bicycle that lies on the ground no goal is sent: reset.sh puts it up again.
# Exit status: 0 accepted (with --wait: reached), 2 bad input or rejected, 3 the bicycle lies or has
# fallen, 4 timed out, missed, given up, or no simulator or controller, 130 interrupted.
set -euo pipefail
ws=$(CDPATH='' builtin cd -P "$(dirname "$(readlink -f "${BASH_SOURCE[0]}")")" && builtin pwd)
# shellcheck source-path=SCRIPTDIR source=lib/common.sh
. "$ws/lib/common.sh"

! help_wanted "$@" || { usage "${BASH_SOURCE[0]}" && exit 0; }
enter_workspace
run goal bicycle_tools.nodes.goal "$@"
