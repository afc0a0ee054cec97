#!/usr/bin/env bash
# Turns a bag into one HTML page that needs no internet: track, state, commands, timing, goals, falls;
# into a film of the ride in 3D; or into the cockpit's page with the ride in it, for any web server.
#
# Usage: report.sh BAG [BAG2] [--output FILE.html] [--png] [--namespace NAME]
#        report.sh BAG --video FILE [--camera NAME] [--from S] [--to S] [--speed X] [--size WxH] [--fps N]
#                      [--against NAME]
#        report.sh BAG... --viewer FOLDER [--against NAME]
#
#   BAG                a bag's folder, an .mcap file, or the folder of a run of ride.sh; one that was
#                      cut short is repaired in a copy, and the page says what was lost
#   BAG2               a second one, drawn beside the first on the same axes
#   --output FILE.html where the page goes; beside the first bag, as NAME-report.html, unless named
#   --png              the figures also as one picture, beside the page
#   --namespace NAME   which bicycle, where a bag holds several
#
#   --video FILE       .mp4 or .webm, for which ffmpeg is needed, or .webp or .gif; Chromium or Chrome
#                      draws it, without a display
#   --camera NAME      chase, orbit, side, rider, top, or tour (unless named), which goes through them
#   --from S, --to S   the part of the ride, s; all of it unless named
#   --speed X          seconds of the ride in a second of the film, 1 unless named
#   --size WxH         pixels, 960x540 unless named; --fps N: pictures a second, 25 unless named
#   --against NAME     a controller that rides the same start, goals and pushes as a ghost: lqr, naf, ppo,
#                      fixed-speed, ... or a policy file; with --video and --viewer
#   --viewer FOLDER    what a browser needs to play the rides: put the folder on any web server, or
#                      try it by python3 -m http.server --directory FOLDER
#
# Exit status: 0 written, 1 a bag cannot be read or the page not be written, 2 bad arguments,
# 130 interrupted.
set -euo pipefail
ws=$(CDPATH='' builtin cd -P "$(dirname "$(readlink -f "${BASH_SOURCE[0]}")")" && builtin pwd)
# shellcheck source-path=SCRIPTDIR source=lib/common.sh
. "$ws/lib/common.sh"

! help_wanted "$@" || { usage "${BASH_SOURCE[0]}" && exit 0; }
enter_workspace
for word in "$@"; do
  case $word in
    --video | --video=* | --viewer | --viewer=*) run report bicycle_cockpit.film.command "$@" ;;
  esac
done
run report bicycle_tools.report_page.command "$@"
