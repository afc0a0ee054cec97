#!/usr/bin/env bash
# Begins a new episode: puts the bicycle upright at a place, also one that has fallen.
#
# Usage: reset.sh [X Y [YAW]] [--speed M_S] [--seed N] [--timeout S] [__ns:=/name]
#        reset.sh --random [--seed N]
#
#   X Y YAW       m and rad in the odom frame, of the rear contact; 0 0 0 unless named
#   --speed M_S   of the start; the scenario's unless named
#   --random      draw place, heading and speed as the scenario does
#   --seed N      of the episode's random numbers; goes on from the present one unless named
#   --timeout S   seconds to wait for the simulator, 10 unless named
#
# The bicycle then waits for its first command: goals from before a reset are cancelled.
# Exit status: 0 reset, 2 bad input or refused, 4 no simulator, 130 interrupted.
set -euo pipefail
ws=$(CDPATH='' builtin cd -P "$(dirname "$(readlink -f "${BASH_SOURCE[0]}")")" && builtin pwd)
# shellcheck source-path=SCRIPTDIR source=lib/common.sh
. "$ws/lib/common.sh"

! help_wanted "$@" || { usage "${BASH_SOURCE[0]}" && exit 0; }
enter_workspace
run reset bicycle_tools.nodes.reset "$@"
