#!/usr/bin/env bash
# Turns a bag into one HTML page that needs no internet: track, state, commands, timing, goals, falls.
#
# Usage: report.sh BAG [BAG2] [--output FILE.html] [--png] [--namespace NAME]
#
#   BAG                a bag's folder, an .mcap file, or the folder of a run of ride.sh; one that was
#                      cut short is repaired in a copy, and the page says what was lost
#   BAG2               a second one, drawn beside the first on the same axes
#   --output FILE.html where the page goes; beside the first bag, as NAME-report.html, unless named
#   --png              the figures also as one picture, beside the page
#   --namespace NAME   which bicycle, where a bag holds several
#
# Exit status: 0 written, 1 a bag cannot be read or the page not be written, 2 bad arguments,
# 130 interrupted.
set -euo pipefail
ws=$(CDPATH='' cd -P "$(dirname "${BASH_SOURCE[0]}")" && pwd)
# shellcheck source-path=SCRIPTDIR source=lib/common.sh
. "$ws/lib/common.sh"

! help_wanted "$@" || { usage "${BASH_SOURCE[0]}" && exit 0; }
enter_workspace
run report bicycle_tools.report_page.command "$@"
