#!/usr/bin/env bash
# Runs the controller: takes goals and answers each state of the bicycle with a command.
#
# Usage: controller.sh [name:=value]... [parameters.yaml]... [__ns:=/name] [--ros-args ...]
#
# Example: controller.sh policy:=lqr
# Exit status: 0 ended by a signal, 2 a bad parameter, 1 anything else.
set -euo pipefail
ws=$(CDPATH='' builtin cd -P "$(dirname "$(readlink -f "${BASH_SOURCE[0]}")")" && builtin pwd)
# shellcheck source-path=SCRIPTDIR source=lib/common.sh
. "$ws/lib/common.sh"

! help_wanted "$@" || { node_usage "${BASH_SOURCE[0]}" bicycle_controller.nodes.controller_node && exit 0; }
run_node controller bicycle_controller.nodes.controller_node "$@"
