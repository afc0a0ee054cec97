#!/usr/bin/env bash
# Runs the trainer: learns from the running bicycle or from bags, and hands better policies over.
#
# Usage: trainer.sh [name:=value]... [parameters.yaml]... [__ns:=/name] [--ros-args ...]
#
# Examples: trainer.sh                                    learn live; the controller explores where it was
#                                                         started with exploration:=ou
#           trainer.sh mode:=bags bags:=runs/2026-01-01-1 learn from a recorded ride
#           trainer.sh out:=runs/trainer-1 resume:=true   go on
#
# The run's folder holds best.safetensors, the policies handed over, the log and the checkpoint.
# Ctrl-C or stop.sh saves and ends it.
# Exit status: 0 ended by a signal, 2 a bad parameter or bags that will not do, 1 anything else.
set -euo pipefail
ws=$(CDPATH='' builtin cd -P "$(dirname "$(readlink -f "${BASH_SOURCE[0]}")")" && builtin pwd)
# shellcheck source-path=SCRIPTDIR source=lib/common.sh
. "$ws/lib/common.sh"

! help_wanted "$@" || { node_usage "${BASH_SOURCE[0]}" bicycle_controller.nodes.trainer_node && exit 0; }
run_node trainer bicycle_controller.nodes.trainer_node "$@"
