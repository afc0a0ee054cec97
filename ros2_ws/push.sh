#!/usr/bin/env bash
# Pushes the bicycle from the side in its next step.
#
# Usage: push.sh left|right [RAD_S] [--timeout S] [__ns:=/name]
#
#   left|right    where the push goes to
#   RAD_S         what the lean rate jumps by, 0.3 rad/s unless named; 2 at most in one step
#   --timeout S   seconds to wait for the simulator, 10 unless named
#
# Exit status: 0 pushed, 2 bad input or refused, 3 the bicycle lies, 4 no simulator, 130 interrupted.
set -euo pipefail
ws=$(CDPATH='' builtin cd -P "$(dirname "$(readlink -f "${BASH_SOURCE[0]}")")" && builtin pwd)
# shellcheck source-path=SCRIPTDIR source=lib/common.sh
. "$ws/lib/common.sh"

! help_wanted "$@" || { usage "${BASH_SOURCE[0]}" && exit 0; }
enter_workspace
run push bicycle_tools.nodes.push "$@"
