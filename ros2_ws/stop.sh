#!/usr/bin/env bash
# Ends what this workspace's scripts started on this ROS domain, and says what that was.
#
# Usage: stop.sh [NAME]...      simulator, controller, recorder, player, ride, goal...; all unless named
#
# A ride and a cockpit are asked first: they end their own processes in good order. The simulator
# goes before the controller, which it would miss, and recorders go last, so that they record the end.
# Who does not follow SIGINT within 10 s gets SIGTERM, and 10 s later SIGKILL. Who may be saving is
# waited for instead, and never killed: recorder, repair, ride, cockpit, trainer. Ctrl-C ends the waiting.
# Exit status: 0 all ended (or nothing ran), 1 something had to be killed or left a bag unfinished,
# 2 bad arguments, 130 interrupted.
set -euo pipefail
ws=$(CDPATH='' builtin cd -P "$(dirname "$(readlink -f "${BASH_SOURCE[0]}")")" && builtin pwd)
# shellcheck source-path=SCRIPTDIR source=lib/common.sh
. "$ws/lib/common.sh"

say() { # WORD...: a line for whoever reads; where nobody does, the work goes on
  printf '%s\n' "$*" 2>/dev/null || true
}

! help_wanted "$@" || { usage "${BASH_SOURCE[0]}" && exit 0; }
for name in "$@"; do
  [[ $name != -* ]] || die 2 "unknown option '$name'; see stop.sh --help."
  [[ $name =~ ^[a-z_]+$ ]] || die 2 "'$name' is no name of what runs here; see stop.sh --help."
done
enter_workspace
trap '' PIPE
folder=$ws/runs/pids/$ROS_DOMAIN_ID
savers=" recorder repair ride cockpit trainer "
status=0
count=0

runs() { # FILE: whether the very process that it names still runs
  local noted state born
  { read -r noted <"$1"; } 2>/dev/null || return 1
  look_at "${1##*.}" && [[ $born == "$noted" && $state != Z ]]
}

bag_of() { # PID: the folder that a recorder writes into
  local bag
  bag=$(tr '\0' '\n' <"/proc/$1/cmdline" | sed -n '/^\(--output\|-o\)$/{n;p};s/^--output=//p' | tail -n 1)
  [[ -z $bag || $bag == /* ]] || bag=$(readlink "/proc/$1/cwd")/$bag
  printf '%s' "$bag"
}

wait_until_gone() { # FILE SECONDS
  local looks=$(($2 * 20))
  while runs "$1"; do
    ((looks-- > 0)) || return 1
    sleep 0.05
  done
}

wait_for_saver() { # FILE: as long as it takes, or until Ctrl-C
  local begun=$SECONDS word=2 waited left=
  trap 'left=1' INT TERM
  while ! wait_until_gone "$1" 1; do
    waited=$((SECONDS - begun))
    if [[ -n $left ]]; then
      die 130 "left $waited_for, which ends alone: do not kill it."
    elif ((waited >= word)); then
      word=$((waited + 10))
      say "waiting for $waited_for ($waited s so far); Ctrl-C leaves it to end alone"
      ((waited < 10)) || kill -s TERM "$pid" 2>/dev/null || true
    fi
  done
  end_on_signals
}

end() { # FILE: ends one process
  local file=$1 pid=${1##*.} name=${1##*/} signal=INT bag waited_for
  name=${name%.*}
  bag=$([[ $name != recorder ]] || bag_of "$pid" 2>/dev/null || true)
  waited_for="$name (process $pid)${bag:+, which is still writing $bag}"
  if runs "$file"; then
    count=$((count + 1))
    kill -s INT "$pid" 2>/dev/null || true
    kill -s CONT "$pid" 2>/dev/null || true # one that is stopped would not follow
    if [[ $savers == *" $name "* ]]; then
      wait_for_saver "$file"
    elif ! wait_until_gone "$file" 10; then
      for signal in TERM KILL; do
        kill -s "$signal" "$pid" 2>/dev/null || true
        wait_until_gone "$file" 10 && break
      done
      [[ $signal != KILL ]] || status=1
    fi
    say "stopped $name (process $pid, SIG$signal)"
    if [[ -n $bag && ! -f $bag/metadata.yaml && -d $bag ]]; then
      say "stop.sh: $bag was not finished; recover it with record.sh --repair $bag" >&2
      status=1
    fi
  fi
  rm -f "$file"
}

end_all() { # NAME...: every process of these names
  local name file
  for name in "$@"; do
    for file in "$folder/$name".*; do
      [[ ! -f $file ]] || end "$file"
    done
  done
}

if (($#)); then
  end_all "$@"
else
  end_all ride cockpit
  others=()
  for file in "$folder"/*; do
    name=${file##*/}
    name=${name%.*}
    case $name in
      '*' | simulator | recorder) ;;
      *) others+=("$name") ;;
    esac
  done
  end_all simulator "${others[@]}" recorder
fi
((count)) || say "nothing of this workspace runs on domain $ROS_DOMAIN_ID"
exit "$status"
