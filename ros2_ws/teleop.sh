#!/usr/bin/env bash
# Rides the bicycle by the keyboard: w faster, s slower, a left, d right, space straight on, q ends.
#
# Usage: teleop.sh [__ns:=/name]
#
# It sends cmd_vel ten times a second; the controller turns it into what the bicycle can ride and goes straight
# on when no more comes (cmd_vel_timeout). A scenario without a pedal keeps its speed: use learned-speed.
# Exit status: 0 after q, 2 bad input or no terminal, 130 interrupted.
set -euo pipefail
ws=$(CDPATH='' builtin cd -P "$(dirname "$(readlink -f "${BASH_SOURCE[0]}")")" && builtin pwd)
# shellcheck source-path=SCRIPTDIR source=lib/common.sh
. "$ws/lib/common.sh"

! help_wanted "$@" || { usage "${BASH_SOURCE[0]}" && exit 0; }
enter_workspace
ros_arguments "$@"
run teleop bicycle_tools.nodes.teleop "${arguments[@]}"
