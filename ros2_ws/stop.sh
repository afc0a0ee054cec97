#!/usr/bin/env bash
# Ends what this workspace's scripts started on this ROS domain, and says what that was.
#
# Usage: stop.sh [NAME]...      simulator, controller, recorder, player, ride, goal...; all unless named
#
# A ride is asked first and given time to write its summary. The simulator goes before the
# controller, which it would miss, and recorders go last, so that they record the end. Who does not follow SIGINT within 2 s gets SIGTERM, then SIGKILL.
# Exit status: 0 all ended (or nothing ran), 1 something had to be killed, 2 bad arguments.
set -euo pipefail
ws=$(CDPATH='' cd -P "$(dirname "${BASH_SOURCE[0]}")" && pwd)
# shellcheck source-path=SCRIPTDIR source=lib/common.sh
. "$ws/lib/common.sh"

! help_wanted "$@" || { usage "${BASH_SOURCE[0]}" && exit 0; }
for name in "$@"; do
  [[ $name != -* ]] || die 2 "unknown option '$name'; see stop.sh --help."
done
enter_workspace
folder=$ws/runs/pids/$ROS_DOMAIN_ID
status=0
count=0

runs() { # FILE: whether the very process that it names still runs
  local file=$1
  [[ -f $file && -d /proc/${file##*.} && $(start_time "${file##*.}" 2>/dev/null) == "$(<"$file")" ]] &&
    [[ $(sed -n 's/^State:\t\(.\).*/\1/p' "/proc/${file##*.}/status" 2>/dev/null) != Z ]]
}

wait_until_gone() { # FILE SECONDS
  local looks=$(($2 * 20))
  while runs "$1"; do
    ((looks-- > 0)) || return 1
    sleep 0.05
  done
}

end() { # FILE PATIENCE: ends one process, PATIENCE seconds after the first signal at the latest
  local file=$1 patience=$2 pid=${1##*.} name=${1##*/} signal
  name=${name%.*}
  if runs "$file"; then
    count=$((count + 1))
    for signal in INT TERM KILL; do
      kill -s "$signal" "$pid" 2>/dev/null || true
      wait_until_gone "$file" "$patience" && break
      patience=2
    done
    [[ $signal != KILL ]] || status=1
    echo "stopped $name (process $pid, SIG$signal)"
  fi
  rm -f "$file"
}

end_all() { # PATIENCE NAME...: every process of these names
  local patience=$1 name file
  shift
  for name in "$@"; do
    for file in "$folder/$name".*; do
      [[ ! -f $file ]] || end "$file" "$patience"
    done
  done
}

if (($#)); then
  end_all 2 "$@"
else
  end_all 30 ride
  others=()
  for file in "$folder"/*; do
    name=${file##*/}
    name=${name%.*}
    case $name in
      '*' | simulator | recorder) ;;
      *) others+=("$name") ;;
    esac
  done
  end_all 2 simulator "${others[@]}" recorder
fi
((count)) || echo "nothing of this workspace runs on domain $ROS_DOMAIN_ID"
exit "$status"
