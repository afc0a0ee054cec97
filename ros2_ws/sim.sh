#!/usr/bin/env bash
# Runs the simulator: integrates the bicycle and publishes its state at 40 Hz.
#
# Usage: sim.sh [name:=value]... [parameters.yaml]... [__ns:=/name] [--ros-args ...]
#
# The bicycle waits at its start until the first command arrives. Ctrl-C or stop.sh ends it.
# Exit status: 0 ended by a signal, 2 a bad parameter, 1 anything else.
set -euo pipefail
ws=$(CDPATH='' builtin cd -P "$(dirname "$(readlink -f "${BASH_SOURCE[0]}")")" && builtin pwd)
# shellcheck source-path=SCRIPTDIR source=lib/common.sh
. "$ws/lib/common.sh"

! help_wanted "$@" || { node_usage "${BASH_SOURCE[0]}" bicycle_sim.nodes.sim_node && exit 0; }
run_node simulator bicycle_sim.nodes.sim_node "$@"
