#!/usr/bin/env bash
# Lets the bicycle follow a course, and waits for its end.
#
# Usage: path.sh NAME|FILE [--laps N] [--speed M_S] [__ns:=/name]
#
#   NAME|FILE        a course, such as slalom or road, or a YAML, CSV or GPX file; docs/paths.md lists them
#   --laps N         of a loop, its own unless named
#   --speed M_S      where no turn limits it, its own unless named
#   __ns:=/name      the bicycle's namespace, where it has one; --namespace /name is the same
#
# Ctrl-C ends the wait; the bicycle rides on.
# Exit status: 0 ridden to its end, 2 bad input or a path that this bicycle cannot ride, 3 fallen,
# 4 lost, replaced or no controller, 130 interrupted.
set -euo pipefail
ws=$(CDPATH='' builtin cd -P "$(dirname "$(readlink -f "${BASH_SOURCE[0]}")")" && builtin pwd)
# shellcheck source-path=SCRIPTDIR source=lib/common.sh
. "$ws/lib/common.sh"

! help_wanted "$@" || { usage "${BASH_SOURCE[0]}" && exit 0; }
enter_workspace
run path bicycle_tools.nodes.path "$@"
