#!/usr/bin/env bash
# Publishes a bag again, or proves that the simulator comes to the same states again.
#
# Usage: replay.sh BAG [--rate R] [--start S] [--loop] [--topics NAME...] [--clock]
#        replay.sh --verify BAG
#
#   --verify BAG   run the recorded commands through the simulator: every state must come out
#                  bit for bit; otherwise the first step that differs is named
#
# Exit status: 0 played or identical, 1 a state differs or the bag cannot be read, 2 bad input.
set -euo pipefail
ws=$(cd -P "$(dirname "${BASH_SOURCE[0]}")" && pwd)
# shellcheck source-path=SCRIPTDIR source=lib/common.sh
. "$ws/lib/common.sh"

! help_wanted "$@" || { usage "${BASH_SOURCE[0]}" && exit 0; }
enter_workspace
if [[ ${1:-} == --verify ]]; then
  run verify bicycle_bringup.nodes.verify "${@:2}"
fi
ros_arguments "$@"
run player bicycle_bag.nodes.player_node "${arguments[@]}"
