#!/usr/bin/env bash
# Records every topic as an MCAP bag that ros2 bag, Foxglove, rosbags and mcap-ros2-support read.
#
# Usage: record.sh [--output FOLDER] [OPTION]... [__ns:=/name] [--ros-args ...]
#        record.sh --repair BAG
#
#   --output FOLDER   the bag's folder, which must not exist; runs/bag-<date> of the workspace unless named,
#                     with -2 and so on for calls of the same second
#   --repair BAG      make a bag whole again that was cut short or damaged, or is compressed as a whole;
#                     of one that is stored as sqlite3 (.db3) make MCAP files beside the databases
#
# It records what is published, so a ride must be running beside it. Ctrl-C or stop.sh ends it and
# closes the bag. On a slow disk that takes a while, which a line tells; a Ctrl-C after that line does not
# wait for the disk any more.
# Exit status: 0 closed, 2 bad input, 130 not waited for the disk, 1 anything else.
set -euo pipefail
ws=$(CDPATH='' builtin cd -P "$(dirname "$(readlink -f "${BASH_SOURCE[0]}")")" && builtin pwd)
# shellcheck source-path=SCRIPTDIR source=lib/common.sh
. "$ws/lib/common.sh"

! help_wanted "$@" || { node_usage "${BASH_SOURCE[0]}" bicycle_bag.nodes.recorder_node && exit 0; }
enter_workspace
if take_word --repair "$@"; then
  run repair bicycle_bag.repair "${rest[@]}"
fi

name_bag() { # Sets bag: another one for each call of the same second, which may be on another domain
  local first notes=$ws/runs/pids note number
  first=$ws/runs/bag-$(date +%Y-%m-%d-%H%M%S)
  mkdir -p "$notes"
  for note in "$notes"/.bag-*; do
    [[ $note == "$notes/.${first##*/}"* ]] || rm -f "$note" # of a second that is over
  done
  for ((number = 1; number < 100; number++)); do
    bag=$first
    ((number == 1)) || bag+=-$number
    if [[ ! -e $bag ]] && (set -C && : >"$notes/.${bag##*/}") 2>/dev/null; then
      return
    fi
  done
}

name_bag
run recorder bicycle_bag.nodes.recorder_node --output "$bag" "$@" # the last --output holds
