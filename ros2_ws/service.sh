#!/usr/bin/env bash
# Looks at services and calls them, as ros2 service does, which the wheels lack.
#
# Usage: service.sh list [--all]
#        service.sh type SERVICE [--timeout S]
#        service.sh call SERVICE [TYPE] [VALUES] [--timeout S]
#
#   --all     also the services that every node offers, such as those for its parameters
#   TYPE      as std_srvs/srv/SetBool; the one that is offered unless named
#   VALUES    of the request, as YAML; what is left out keeps its default
#   S         seconds to wait for the service, and again for its answer, 10 unless named
#
# Examples: service.sh call bicycle/pause '{data: true}'
#           service.sh call bicycle/step
#           service.sh call bicycle/load_policy '{path: lqr}'
#           service.sh call /bicycle_player/resume std_srvs/srv/Trigger
#
# A name without a slash in front is in the namespace of __ns:=/name, or in /.
# Exit status: 0, 1 no such service or it answered success: false, 2 bad arguments, 4 no answer,
# 130 interrupted.
set -euo pipefail
ws=$(CDPATH='' builtin cd -P "$(dirname "$(readlink -f "${BASH_SOURCE[0]}")")" && builtin pwd)
# shellcheck source-path=SCRIPTDIR source=lib/common.sh
. "$ws/lib/common.sh"

! help_wanted "$@" || { usage "${BASH_SOURCE[0]}" && exit 0; }
enter_workspace
run service bicycle_tools.nodes.service "$@"
