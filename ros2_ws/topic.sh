#!/usr/bin/env bash
# Looks at topics, as ros2 topic does, which the wheels lack.
#
# Usage: topic.sh list
#        topic.sh info TOPIC
#        topic.sh echo TOPIC [--once] [--field NAME]
#        topic.sh rate TOPIC [--seconds S]
#
# Exit status: 0, 1 no such topic or no message, 2 bad arguments.
set -euo pipefail
ws=$(CDPATH='' cd -P "$(dirname "${BASH_SOURCE[0]}")" && pwd)
# shellcheck source-path=SCRIPTDIR source=lib/common.sh
. "$ws/lib/common.sh"

! help_wanted "$@" || { usage "${BASH_SOURCE[0]}" && exit 0; }
enter_workspace
run topic bicycle_bringup.nodes.topic "$@"
