# shellcheck shell=bash disable=SC2154 # ws is the caller's: the folder of the workspace
# What the scripts share: messages, help, the environment, and how a node is started. Sourced.

no_habits() { # Of the caller: options by SHELLOPTS or BASHOPTS, functions that it exports, what BASH_ENV sets
  local name
  for name in $(compgen -A function); do
    unset -f "$name"
  done
  unalias -a
  unset BASH_ENV
  set +fk +o noclobber
  shopt -u failglob nocasematch nocaseglob nullglob
}
set +fk # without it the next line may do nothing
no_habits

end_on_signals() { # Without it, a signal is lost that comes while another program runs and ends well
  trap 'exit 130' INT
  trap 'exit 143' TERM
  trap 'exit 129' HUP
}
end_on_signals

open_streams() { # The number of a closed one would go to the next file that is opened: a bag, say
  [[ -e /dev/fd/0 ]] || exec </dev/null
  [[ -e /dev/fd/1 ]] || exec >/dev/null
  [[ -e /dev/fd/2 ]] || exec 2>/dev/null
}
open_streams

die() { # STATUS MESSAGE: one line for a person, then out
  local line=${2//[[:cntrl:]]/ }
  ((${#line} <= 1000)) || line="${line:0:500} ... ${line: -200}"
  printf '%s: %s\n' "$(basename "$0")" "$line" >&2
  exit "$1"
}

pwd -P >/dev/null 2>&1 || die 1 "the working directory is not there any more: change to another."

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

help_wanted() { # ARGUMENT...: whether one of them asks for help
  local word
  for word in "$@"; do
    [[ $word != -h && $word != --help ]] || return 0
  done
  return 1
}

take_word() { # WORD ARGUMENT...: whether WORD is among the arguments; sets rest to the others
  local wanted=$1 word found=1
  shift
  rest=()
  for word in "$@"; do
    if [[ $word == "$wanted" && $found == 1 ]]; then
      found=0
    else
      rest+=("$word")
    fi
  done
  return "$found"
}

node_usage() { # SCRIPT MODULE: its help, then the node's own, which lists the parameters
  usage "$1"
  if [[ -d $ws/install/bicycle_msgs ]]; then
    enter_workspace
    echo
    "$python" -m "$2" --help | sed '/^usage:/,/^$/d'
  fi
}

enter_workspace() { # Loads env.sh, or says what to do
  local status=0
  # shellcheck source-path=SCRIPTDIR source=../env.sh
  . "$ws/env.sh" || status=$?
  ((status == 0)) || exit "$status"
  export PYTHONSAFEPATH=1 # a module in the working directory must not take another's place
  [[ -d $ws/install/bicycle_msgs ]] || die 1 "the workspace is not built; run $ws/setup.sh first."
  if [[ -n ${VIRTUAL_ENV:-} && :$PATH: == *":$VIRTUAL_ENV/bin:"* ]]; then
    python=$VIRTUAL_ENV/bin/python
  else
    python=python3 # a native ROS 2
  fi
}

look_at() { # PID: sets its state and when it was born in the kernel's ticks, which with the pid names it
  local stat= fields
  # No $( ): a trap that strikes within one is lost, or ends bash with a syntax error (5.2.15).
  { read -r -d '' stat <"/proc/$1/stat" || [[ -n $stat ]]; } 2>/dev/null || return 1
  read -ra fields <<<"${stat##*) }" # the name in brackets before may hold spaces
  state=${fields[0]} born=${fields[19]}
}

register() { # NAME: lets stop.sh find this process, which keeps its pid through exec
  local folder=$ws/runs/pids/$ROS_DOMAIN_ID file pid state born
  mkdir -p "$folder"
  for file in "$folder"/*; do
    pid=${file##*.}
    [[ ! -f $file || -d /proc/$pid ]] || rm -f "$file"
  done
  look_at $$
  echo "$born" >"$folder/$1.$$"
}

ros_arguments() { # ARGUMENT...: sets arguments, with name:=value and *.yaml turned into what ROS takes
  local word ros=() own=()
  while (($#)); do
    word=$1
    shift
    case $word in
      --ros-args)
        while (($#)) && [[ $1 != -- ]]; do
          ros+=("$1")
          shift
        done
        (($# == 0)) || shift
        ;;
      --*) own+=("$word") ;;
      __*:=*) ros+=(-r "$word") ;;
      *:=*) ros+=(-p "$word") ;;
      *.yaml | *.yml)
        [[ -f $word ]] || die 2 "no parameter file '$word'."
        ros+=(--params-file "$word")
        ;;
      *) own+=("$word") ;;
    esac
  done
  arguments=("${own[@]}")
  ((${#ros[@]} == 0)) || arguments+=(--ros-args "${ros[@]}")
}

run() { # NAME MODULE ARGUMENT...: becomes that Python program, so that signals and its status pass
  local name=$1 module=$2
  shift 2
  register "$name"
  start "$module" "$@"
}

start() { # MODULE ARGUMENT...: becomes that Python program; signals wait until it can answer them
  local wait=(env --block-signal=INT,TERM,HUP)
  "${wait[@]}" true 2>/dev/null || wait=()
  trap - INT TERM HUP # bash forgets one that it has caught and not answered when it becomes another program
  exec "${wait[@]}" "$python" -m "$@"
}

run_node() { # NAME MODULE ARGUMENT...: the same for a node: its config/NAME.yaml, then the arguments
  local name=$1 module=$2 config=$ws/src/bicycle_bringup/config/$1.yaml arguments
  shift 2
  enter_workspace
  [[ ! -f $config ]] || set -- "$config" "$@"
  ros_arguments "$@"
  run "$name" "$module" "${arguments[@]}"
}
