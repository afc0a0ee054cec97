#!/usr/bin/env bash
# Shows the bicycle in the browser and lets you ride it there: simulator, controller and one web page.
#
# Usage: cockpit.sh [--no-ride] [--port N] [--bags FOLDER] [--models FOLDER]
#                   [--bind ADDRESS --token auto|--token-file FILE [--host-name NAME]...]
#                   [NODE.name:=value]... [__ns:=/name] [--ros-args ...]
#
#   --no-ride         start neither simulator nor controller: show what runs already
#   --port N          8765 unless named; 0 takes a free one
#   --bags FOLDER     bags to look at, and where new ones are recorded; runs of the workspace unless named
#   --models FOLDER   policy files to choose from, besides those shipped; runs of the repository unless named
#   --bind ADDRESS    127.0.0.1 unless named; anything wider lets other machines in and needs a token
#   --token auto      have a secret made that a page must know; the printed address holds it
#   --token-file FILE take the secret from a file that only you can read: at least 16 letters and digits;
#                     the variable BICYCLE_COCKPIT_TOKEN does the same
#   --host-name NAME  a name by which other machines call this one, if not by number
#   NODE.name:=value  a parameter of simulator or controller, such as controller.policy:=lqr
#   __ns:=/name       the bicycle's namespace, also of what is started
#
# The first call sets everything up, which takes some minutes. Then open the address that it prints and
# click on the map. Where several bicycles ride in the domain, as with fleet.sh, the map shows all of them
# and the list "Bicycle" chooses the one that is steered. Ctrl-C ends all of it.
# Exit status: 0 ended by a signal, 2 bad arguments or a part that cannot run, 1 anything else.
set -euo pipefail
ws=$(CDPATH='' builtin cd -P "$(dirname "$(readlink -f "${BASH_SOURCE[0]}")")" && builtin pwd)
# shellcheck source-path=SCRIPTDIR source=lib/common.sh
. "$ws/lib/common.sh"

! help_wanted "$@" || { usage "${BASH_SOURCE[0]}" && exit 0; }
"$ws/setup.sh" --quiet
enter_workspace
run cockpit bicycle_cockpit.nodes.cockpit "$@"
