# shellcheck shell=bash
# What the scripts share. Sourced; the caller sets ws to the folder of the workspace.

die() { # STATUS MESSAGE: one line for a person, then out
  printf '%s: %s\n' "$(basename "$0")" "$2" >&2
  exit "$1"
}

have() { # COMMAND: whether it can be found
  command -v "$1" >/dev/null 2>&1
}

join() { # SEPARATOR WORD...
  local separator=$1 words=$2
  shift 2
  while (($#)); do
    words+=$separator$1
    shift
  done
  printf '%s' "$words"
}

usage() { # SCRIPT: its opening comment is its help
  sed -n '2,/^[^#]/{s/^# \{0,1\}//p}' "$1"
}
