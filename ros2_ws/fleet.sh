#!/usr/bin/env bash
# Rides several bicycles in one domain: each in a namespace of its own, on a route that crosses others'.
#
# Usage: fleet.sh [BICYCLES] [--seed S] [--speed M_S] [--blind] [--output FOLDER] [NODE.name:=value]...
#
#   BICYCLES          how many, 10 unless named, 20 at most; they are called /b1, /b2 and so on
#   --seed S          of the routes, 0 unless named
#   --speed M_S       on the routes, 3 unless named
#   --blind           do not let them keep clear of one another
#   --output FOLDER   where the run goes, which must not exist; runs/fleet-<date> of the workspace unless named
#   NODE.name:=value  a parameter of every simulator or controller, such as simulator.plant:=whipple
#
# The first one publishes /clock for all. fleet.json in the run's folder tells for each how far off its route
# it was and how late its steps began and were answered, and for each pair how near the two came.
# goal.sh, push.sh, reset.sh and record.sh take one of them as __ns:=/b1; cockpit.sh --no-ride shows all.
# Exit status: 0 all routes ridden to their ends, 4 one not, 1 a part failed, 2 bad arguments, 130 interrupted.
set -euo pipefail
ws=$(CDPATH='' builtin cd -P "$(dirname "$(readlink -f "${BASH_SOURCE[0]}")")" && builtin pwd)
# shellcheck source-path=SCRIPTDIR source=lib/common.sh
. "$ws/lib/common.sh"

! help_wanted "$@" || { usage "${BASH_SOURCE[0]}" && exit 0; }
"$ws/setup.sh" --quiet
enter_workspace
run fleet bicycle_bringup.nodes.fleet "$@"
