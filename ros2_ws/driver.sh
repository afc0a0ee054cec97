#!/usr/bin/env bash
# Runs the driver of a real bicycle: between the topics and its microcontroller's serial line.
#
# Usage: driver.sh [name:=value]... [parameters.yaml]... [__ns:=/name] [--ros-args ...]
#
# Nothing moves before bicycle/arm: service.sh call bicycle/arm '{data: true}'. docs/real-bicycle.md has the rest.
#
# Example: driver.sh port:=/dev/ttyACM0 bicycle:=my-bicycle.yaml
# Exit status: 0 ended by a signal, 2 a bad parameter, 1 anything else.
set -euo pipefail
ws=$(CDPATH='' builtin cd -P "$(dirname "$(readlink -f "${BASH_SOURCE[0]}")")" && builtin pwd)
# shellcheck source-path=SCRIPTDIR source=lib/common.sh
. "$ws/lib/common.sh"

! help_wanted "$@" || { node_usage "${BASH_SOURCE[0]}" bicycle_hardware.nodes.driver_node && exit 0; }
run_node driver bicycle_hardware.nodes.driver_node "$@"
