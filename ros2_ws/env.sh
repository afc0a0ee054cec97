# shellcheck shell=bash
# The environment of this workspace, for a shell: `. ros2_ws/env.sh` from any directory (bash or zsh).
#
# Choices, read from the environment:
#   BICYCLE_NETWORK   local (default): DDS on 127.0.0.1 only; lan: DDS on every network interface, with
#                     FASTRTPS_DEFAULT_PROFILES_FILE if it is set
#   ROS_DOMAIN_ID     0 to 101, 42 unless set: only nodes with the same number meet
#   BICYCLE_KEEP      names of variables that are kept although lib/shell.sh would set them aside
#
# What another set-up has left in the shell and does not fit (another middleware, another numpy) is set aside,
# in one line that names it; lib/shell.sh decides.
#
# It exports the few variables that colcon's setup scripts would work out in half a second. With a
# sourced /opt/ros/jazzy it uses that ROS 2 and no virtual environment: the two never mix.

if [ -z "${BASH_VERSION:-}${ZSH_VERSION:-}" ]; then # such as dash, Debian's sh
  echo "env.sh: it needs bash or zsh: source it in one of them." >&2
  # shellcheck disable=SC2317 # false in a script that is run instead of sourced
  return 1 2>/dev/null || exit 1
fi
# shellcheck disable=SC2128 # the first is this file
if [ -n "${BASH_VERSION:-}" ] && [ "$BASH_SOURCE" = "$0" ]; then
  echo "env.sh: it changes nothing when it is run: source it, as in . env.sh" >&2
  exit 2
fi

_bicycle_prepend() { # NAME DIRECTORY: puts DIRECTORY first in the path variable NAME, and only there
  local old
  eval "old=:\${$1:-}:"
  while [[ $old == *":$2:"* ]]; do old=${old/":$2:"/:}; done
  old=${old#:}
  old=${old%:}
  export "$1=$2${old:+:$old}"
}

_bicycle_network() { # WORKSPACE: chooses where DDS traffic goes, and checks the domain
  # In a variable: zsh with sh_glob cannot even parse it as it stands.
  local own=${FASTRTPS_DEFAULT_PROFILES_FILE:-} range=SUBNET whole='^(0|[1-9][0-9]{0,2})$'
  case ${BICYCLE_NETWORK:-local} in
    local)
      # Fast DDS also reads a profile from the working directory, which would open this one again.
      export FASTRTPS_DEFAULT_PROFILES_FILE=$1/fastdds_local.xml SKIP_DEFAULT_XML_FILE=1
      # Another middleware does not know the profile. For Fast DDS, LOCALHOST would add shared memory.
      [[ ${RMW_IMPLEMENTATION:-rmw_fastrtps_cpp} == rmw_fastrtps_* ]] || range=LOCALHOST
      ;;
    lan)
      [[ $own != "$1"/fastdds_local.xml ]] || unset SKIP_DEFAULT_XML_FILE
      [[ -n $own && $own != "$1"/fastdds_local.xml ]] ||
        export FASTRTPS_DEFAULT_PROFILES_FILE=$1/fastdds_lan.xml
      ;;
    *)
      echo "env.sh: BICYCLE_NETWORK is '$BICYCLE_NETWORK'; set it to 'local' or 'lan'." >&2
      return 2
      ;;
  esac
  export ROS_AUTOMATIC_DISCOVERY_RANGE=$range
  export ROS_DOMAIN_ID=${ROS_DOMAIN_ID:-42}
  if ! [[ $ROS_DOMAIN_ID =~ $whole ]] || ((ROS_DOMAIN_ID > 101)); then
    echo "env.sh: ROS_DOMAIN_ID is '$ROS_DOMAIN_ID'; set it to a whole number from 0 to 101." >&2
    return 2
  fi
}

_bicycle_wheels() { # VENV: ROS 2 from the virtual environment
  local venv=$1 folder
  if [[ ! -x $venv/bin/python ]]; then
    echo "env.sh: no virtual environment at $venv; run ros2_ws/setup.sh first." >&2
    return 1
  fi
  export VIRTUAL_ENV=$venv ROS_DISTRO=jazzy ROS_VERSION=2 ROS_PYTHON_VERSION=3
  _bicycle_prepend PATH "$venv/bin"
  _bicycle_prepend AMENT_PREFIX_PATH "$venv"
  for folder in "$venv"/lib/python3.*/site-packages/ros_*.libs; do
    [[ ! -d $folder ]] || _bicycle_prepend LD_LIBRARY_PATH "$folder"
  done
  _bicycle_prepend LD_LIBRARY_PATH "$venv/lib"
  # The wheels' start-up hook re-executes Python to set LD_LIBRARY_PATH, in random order and for
  # 80 ms each time. The path is complete here, so the hook is told that its work is done.
  export _ROS_WHEELS_BOOTSTRAP_COMPLETE=1
}

_bicycle_overlay() { # WORKSPACE: the packages that colcon built, and the sources of the Python ones
  local ws=$1 folder package
  for folder in "$ws"/install/tf2_msgs "$ws"/install/bicycle_*; do
    [[ -d $folder ]] || continue
    _bicycle_prepend AMENT_PREFIX_PATH "$folder"
    [[ ! -d $folder/lib ]] || _bicycle_prepend LD_LIBRARY_PATH "$folder/lib"
  done
  for folder in "$ws"/install/tf2_msgs/lib/python3*/*-packages "$ws"/install/bicycle_msgs/lib/python3*/*-packages; do
    [[ ! -d $folder ]] || _bicycle_prepend PYTHONPATH "$folder"
  done
  for package in "$ws"/src/bicycle_*; do
    [[ ! -d $package/${package##*/} ]] || _bicycle_prepend PYTHONPATH "$(builtin cd -P "$package" && builtin pwd)"
  done
}

_bicycle_logs() { # WORKSPACE: where nodes log; each process leaves a file, each launch a folder; the newest 20 stay
  export ROS_LOG_DIR=${ROS_LOG_DIR:-$1/log/ros}
  [[ $ROS_LOG_DIR == "$1/log/ros" && -d $ROS_LOG_DIR ]] || return 0
  # shellcheck disable=SC2012 # the names are ROS's own: node, process, milliseconds
  (builtin cd "$ROS_LOG_DIR" && command ls -t | tail -n +21 | while read -r old; do command rm -rf -- "$old"; done)
}

_bicycle_environment() { # In options of its own: the caller's may be others, and stay
  local result unmatched caseless # without values: with set -k they would be no arguments
  if [[ -n ${ZSH_VERSION:-} ]]; then
    emulate -L zsh
    setopt null_glob ksh_arrays
    _bicycle_load
  else
    local -
    set +fk
    result=0 unmatched=-u caseless=-u
    # No $(shopt -p): a script's trap that strikes within $( ) is lost.
    if shopt -q failglob; then unmatched=-s; fi
    if shopt -q nocasematch; then caseless=-s; fi
    shopt -u failglob nocasematch
    _bicycle_load || result=$?
    shopt "$unmatched" failglob
    shopt "$caseless" nocasematch
    return "$result"
  fi
}

_bicycle_load() {
  local here ws venv=''
  if [[ -n ${ZSH_VERSION:-} ]]; then
    eval 'here=${(%):-%x}'
  else
    here=${BASH_SOURCE[0]}
  fi
  ws=$(CDPATH='' builtin cd -P "$(dirname "$(readlink -f -- "$here")")" && builtin pwd) || return 1
  # shellcheck source-path=SCRIPTDIR source=lib/shell.sh
  . "$ws/lib/shell.sh"
  case ":${AMENT_PREFIX_PATH:-}:" in
    *:/opt/ros/jazzy:*) ;;
    *:/opt/ros/*)
      echo "env.sh: ROS 2 '${ROS_DISTRO:-}' is sourced here, but this workspace needs jazzy: open a fresh shell." >&2
      return 1
      ;;
    *) venv=$(dirname "$ws")/.venv ;;
  esac
  _bicycle_set_aside run "$(dirname "$ws")" "$venv"
  [[ -z $_bicycle_aside ]] || echo "env.sh: $_bicycle_aside" >&2
  [[ -z $venv ]] || _bicycle_wheels "$venv" || return
  _bicycle_network "$ws" || return
  _bicycle_overlay "$ws"
  _bicycle_prepend PATH "$ws/bin"
  _bicycle_logs "$ws"
  export BICYCLE_WS=$ws OMP_NUM_THREADS=${OMP_NUM_THREADS:-1}
}

_bicycle_environment
# A sourced file's last status is the caller's $?, so the helpers go without changing it.
_bicycle_status=$?
unset -f _bicycle_prepend _bicycle_network _bicycle_wheels _bicycle_overlay _bicycle_logs _bicycle_environment \
  _bicycle_load _bicycle_set_aside _bicycle_exported _bicycle_holds _bicycle_builds _bicycle_has_middleware \
  _bicycle_entries_hold _bicycle_hides _bicycle_python_names _bicycle_library_names _bicycle_package_names
unset _bicycle_aside
if ((_bicycle_status)); then
  unset _bicycle_status
  # shellcheck disable=SC2317 # false in a script that is run instead of sourced
  return 1 2>/dev/null || exit 1
fi
unset _bicycle_status
