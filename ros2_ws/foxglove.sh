#!/usr/bin/env bash
# Serves all topics to Foxglove by its own WebSocket protocol; takes goals and calls from its panels if told to.
#
# Usage: foxglove.sh [name:=value]... [parameters.yaml]... [__ns:=/name] [--ros-args ...]
#
# Examples: foxglove.sh                    then open ws://127.0.0.1:8765 in Foxglove, with the layout
#                                          src/bicycle_bringup/config/foxglove-layout.json
#           foxglove.sh publish:=true      also takes goals, poses and service calls; any web page open on
#                                          this machine could then send them, too
#
# Needs foxglove-sdk, once: setup.sh --with foxglove. Listens on this machine alone unless host:= says
# otherwise. Ctrl-C or stop.sh ends it.
# Exit status: 0 ended by a signal, 2 a bad parameter or a port that is taken, 1 anything else.
set -euo pipefail
ws=$(CDPATH='' builtin cd -P "$(dirname "$(readlink -f "${BASH_SOURCE[0]}")")" && builtin pwd)
# shellcheck source-path=SCRIPTDIR source=lib/common.sh
. "$ws/lib/common.sh"

! help_wanted "$@" || { node_usage "${BASH_SOURCE[0]}" bicycle_tools.nodes.foxglove_server 2>/dev/null && exit 0; }
enter_workspace
"$python" -c 'import foxglove' 2>/dev/null || die 2 "foxglove-sdk is not installed: run setup.sh --with foxglove"
run_node foxglove bicycle_tools.nodes.foxglove_server "$@"
