#!/usr/bin/env bash
# Publishes a bag again, or proves that the simulator comes to the same states again.
#
# Usage: replay.sh BAG [OPTION]...
#        replay.sh --verify BAG
#
#   --verify BAG   run the recorded commands through the simulator: every state must come out
#                  bit for bit; otherwise the first step that differs is named. Of a ride from
#                  sensors, also or, on a real bicycle, only: estimates and commands, from the
#                  recorded readings
#
# It refuses to play what another node publishes, and ends when one begins to: a simulator or a
# controller beside it would take the bag's messages for the bicycle's. While it plays, the space bar
# pauses and goes on, the right arrow plays the next message, up and down change the speed; so do the
# services /bicycle_player/pause, resume, toggle_paused and play_next (service.sh call).
#
# Examples: replay.sh my-ride --rate 2 --start-offset 10 --playback-duration 5
#           replay.sh my-ride --exclude-topics /clock /bicycle/markers
#           replay.sh my-ride --topics /odom --remap /odom:=/ghost/odom
#           replay.sh my-ride --pause
#
# Exit status: 0 played or identical, 1 a state differs, the bag cannot be read or others publish the
# same topics, 2 bad input.
set -euo pipefail
ws=$(CDPATH='' builtin cd -P "$(dirname "$(readlink -f "${BASH_SOURCE[0]}")")" && builtin pwd)
# shellcheck source-path=SCRIPTDIR source=lib/common.sh
. "$ws/lib/common.sh"

! help_wanted "$@" || { node_usage "${BASH_SOURCE[0]}" bicycle_bag.nodes.player_node && exit 0; }
enter_workspace
if take_word --verify "$@"; then
  run verify bicycle_tools.nodes.verify "${rest[@]}"
fi
run player bicycle_bag.nodes.player_node "$@"
