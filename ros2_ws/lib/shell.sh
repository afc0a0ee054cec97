# shellcheck shell=bash
# What of the calling shell's environment holds here, and what is set aside: the one place that decides it.
# Sourced by env.sh (in bash and in zsh) and by setup.sh.
#
# A shell that was set up for something else (Nav2, another ROS, conda, a debugger) has variables that reach
# into this stack: another middleware, another numpy, another network. They are judged in families: a name
# of a family that stands in no list here is set aside, so one that a later version invents is, too.
# BICYCLE_KEEP="NAME NAME" keeps what it names.

_bicycle_set_aside() { # run|build ROOT VENV: unsets what does not hold and sets _bicycle_aside to what and why
  local use=$1 root=$2 venv=$3 name value kept reason
  _bicycle_aside=
  while IFS= read -r name; do
    [[ " ${BICYCLE_KEEP:-} " != *" $name "* ]] || continue
    eval "value=\${$name-}"
    reason='' kept=''
    case $name in
      PYTHONPATH | LD_LIBRARY_PATH | AMENT_PREFIX_PATH | LD_PRELOAD) _bicycle_entries_hold "$name" "$value" ;;
      *) _bicycle_holds "$name" "$value" && { [[ $use == run ]] || _bicycle_builds "$name" "$value"; } ;;
    esac && continue
    _bicycle_aside+="${_bicycle_aside:+, }$name${reason:+ ($reason)}"
    if [[ -n $kept ]]; then export "$name=$kept"; else unset "$name"; fi
  done < <(_bicycle_exported)
  [[ -z $_bicycle_aside ]] || _bicycle_aside="set aside: $_bicycle_aside. To keep one: BICYCLE_KEEP=NAME."
}

_bicycle_exported() { # Prints the names of all exported variables
  if [[ -n ${ZSH_VERSION:-} ]]; then
    eval 'print -l -- ${(ok)parameters[(R)*export*]}'
  else
    compgen -e
  fi
}

_bicycle_holds() { # NAME VALUE: whether a variable stays when something is run
  case $1 in
    # setup.sh's choice; how Python writes and colours, where it caches, what it does at its prompt.
    PYTHON | PYTHONUNBUFFERED | PYTHONDONTWRITEBYTECODE | PYTHONFAULTHANDLER | PYTHONPYCACHEPREFIX | PYTHONNOUSERSITE | \
      PYTHONSTARTUP | PYTHONSAFEPATH | PYTHONBREAKPOINT | PYTHON_HISTORY | PYTHON_COLORS | PYTHON_BASIC_REPL) ;;
    PYTHONUTF8) [[ $2 == [01] ]] ;;
    PYTHONHASHSEED) [[ $2 == random || $2 =~ ^[0-9]{1,9}$ ]] ;;
    # Other libraries (HOME, PLATLIBDIR), no docstrings (OPTIMIZE), a prompt at the end (INSPECT), warnings that
    # end a program, ...
    PYTHON* | _PYTHON* | __PYVENV_LAUNCHER__ | _CONDA_PYTHON_SYSCONFIGDATA_NAME) return 1 ;;

    ROS_DOMAIN_ID | ROS_HOME | ROS_DISTRO | ROS_VERSION | ROS_PYTHON_VERSION | ROS_SECURITY_* | \
      ROS_PYTHON_CHECK_FIELDS | ROS_DISABLE_LOANED_MESSAGES) ;;
    ROS_LOG_DIR) command mkdir -p "$2" 2>/dev/null && [[ -w $2 ]] || { reason="no folder to write to" && return 1; } ;;
    ROS_ROOT | ROS_ETC_DIR | ROS_PACKAGE_PATH | ROS_MASTER_URI | ROS_HOSTNAME | ROS_IP) ;; # ROS 1's, unread
    ROS_AUTOMATIC_DISCOVERY_RANGE) [[ $2 == SUBNET || $2 == LOCALHOST ]] ;;               # env.sh chooses it anew
    ROS_LOCALHOST_ONLY) return 1 ;;                                                        # overrides that range
    RMW_IMPLEMENTATION) _bicycle_has_middleware "$2" || { reason="$2 is not installed here" && return 1; } ;;
    RCUTILS_COLORIZED_OUTPUT | RCUTILS_LOGGING_USE_STDOUT | RCUTILS_LOGGING_BUFFERED_STREAM) [[ $2 == [01] ]] ;;
    RCUTILS_CONSOLE_OUTPUT_FORMAT) ;;
    RCL_* | RCUTILS_*) return 1 ;;
    FASTRTPS_DEFAULT_PROFILES_FILE) [[ ${BICYCLE_NETWORK:-local} == lan || $2 == "$root"/ros2_ws/fastdds_*.xml ]] ;;
    # On the local network these lead out of it, or to a server that is not there.
    ROS_* | RMW_* | FASTDDS_* | FASTRTPS_* | CYCLONEDDS_*) [[ ${BICYCLE_NETWORK:-local} == lan ]] ;;

    TMPDIR | TEMP | TMP) [[ -d $2 && -w $2 ]] || { reason="no folder to write to" && return 1; } ;;
    MPLBACKEND | MATPLOTLIBRC) return 1 ;; # pictures are drawn into files, in the packages' own style
    RAY_ADDRESS) return 1 ;;               # learning starts its own, unless it is told otherwise
  esac
}

_bicycle_builds() { # NAME VALUE: whether it stays besides when packages are installed and built
  case $1 in
    CMAKE_BUILD_PARALLEL_LEVEL | CMAKE_*_COMPILER_LAUNCHER | CMAKE_COLOR_DIAGNOSTICS) ;;
    MAKEFLAGS) [[ $2 =~ ^-?j\ *[0-9]+$ || $2 =~ ^--jobs=[0-9]+$ ]] ;;
    CC | CXX) command -v "${2%% *}" >/dev/null || { reason="no such compiler" && return 1; } ;;
    # Flags would change the last bits of what is computed, or stop the build at a warning.
    CMAKE_* | COLCON_* | AMENT_* | Python*_ROOT* | Python*_EXECUTABLE | Python*_DIR | CFLAGS | CXXFLAGS | CPPFLAGS | \
      LDFLAGS | ASMFLAGS | ARCHFLAGS | MFLAGS | GNUMAKEFLAGS | MAKEFILES | MAKEOVERRIDES | DESTDIR | CPATH | \
      C_INCLUDE_PATH | CPLUS_INCLUDE_PATH | LIBRARY_PATH | LD_RUN_PATH | COMPILER_PATH | GCC_EXEC_PREFIX | \
      DEPENDENCIES_OUTPUT | SETUPTOOLS_* | DISTUTILS_* | PYTHONSAFEPATH | PYTHONPYCACHEPREFIX) return 1 ;;
    # Where packages come from holds; where they would go, and what pip would do instead, does not.
    PIP_INDEX_URL | PIP_EXTRA_INDEX_URL | PIP_FIND_LINKS | PIP_NO_INDEX | PIP_TRUSTED_HOST | PIP_PROXY | PIP_CERT | \
      PIP_CLIENT_CERT | PIP_KEYRING_PROVIDER | PIP_TIMEOUT | PIP_DEFAULT_TIMEOUT | PIP_RETRIES | PIP_CACHE_DIR | \
      PIP_NO_CACHE_DIR | PIP_CONFIG_FILE | PIP_CONSTRAINT | PIP_LOG | PIP_DISABLE_PIP_VERSION_CHECK | PIP_NO_INPUT | \
      PIP_PROGRESS_BAR | PIP_QUIET | PIP_VERBOSE | PIP_NO_COLOR | PIP_ROOT_USER_ACTION | PIP_BREAK_SYSTEM_PACKAGES | \
      PIP_REQUIRE_VIRTUALENV) ;;
    UV_DEFAULT_INDEX | UV_INDEX | UV_INDEX_* | UV_EXTRA_INDEX_URL | UV_FIND_LINKS | UV_NO_INDEX | UV_INSECURE_HOST | \
      UV_NATIVE_TLS | UV_SYSTEM_CERTS | UV_HTTP_* | UV_KEYRING_PROVIDER | UV_CACHE_DIR | UV_NO_CACHE | UV_LINK_MODE | \
      UV_CONFIG_FILE | UV_CONCURRENT_* | UV_OFFLINE | UV_NO_PROGRESS) ;;
    PIP_* | UV_*) return 1 ;;
  esac
}

_bicycle_has_middleware() { # NAME: whether its library is there, in the wheels or in a sourced ROS 2
  local folder
  while IFS= read -r -d : folder; do
    [[ -n $folder && -e $folder/lib/lib$1.so ]] && return
  done <<<"$venv:${AMENT_PREFIX_PATH:-}:"
  [[ -z $1 ]]
}

_bicycle_entries_hold() { # NAME VALUE: whether every entry of a list stays; else sets kept and reason
  local entry hides
  while IFS= read -r -d : entry; do
    [[ -n $entry ]] || continue # the working directory, mostly by accident
    hides=
    case $1:$entry in
      *:"$root"/*) ;; # what env.sh set
      LD_PRELOAD:*/*) [[ -e $entry ]] || hides="$entry is missing" ;;
      LD_PRELOAD:* | *:/opt/ros/*) ;;
      PYTHONPATH:*) hides=$(_bicycle_hides "$entry" . _bicycle_python_names) ;;
      LD_LIBRARY_PATH:*) hides=$(_bicycle_hides "$entry" .so _bicycle_library_names) ;;
      *) hides=$(_bicycle_hides "$entry/share/ament_index/resource_index/packages" . _bicycle_package_names) ;;
    esac
    if [[ -n $hides ]]; then
      reason+=${reason:+, }$hides
    else
      kept+=${kept:+:}$entry
    fi
  done <<<"$2:"
  [[ -z $reason ]] && export "$1=$kept"
}

_bicycle_hides() { # FOLDER END NAMES...: prints what of those that the command NAMES prints FOLDER has, too
  local item name names
  [[ -d $1 && -x $venv/bin/python ]] || return 0
  names=$'\n'$($3 | LC_ALL=C command sort -u)$'\n'
  while IFS= read -r item; do
    name=${item%%"$2"*}
    if [[ -n $name && $names == *$'\n'"$name"$'\n'* ]]; then
      printf '%s has another %s' "${1%/share/ament_index/*}" "$name"
      return
    fi
  done < <(command ls "$1")
}

_bicycle_python_names() { # Modules of the standard library, of the wheels and of this workspace
  local version home folder
  for folder in "$venv"/lib/python3.*; do version=${folder##*/}; done
  home=$(command sed -n 's/^home = //p' "$venv/pyvenv.cfg")
  command ls "$venv/lib/$version/site-packages" "${home%/*}/lib/$version" "$root" "$root/ros2_ws/src" 2>/dev/null |
    command sed 's/\..*//'
}

_bicycle_library_names() { # Libraries of the wheels and of the system, without their versions
  command ls "$venv/lib" "$venv"/lib/python3.*/site-packages/ros_*.libs /lib/x86_64-linux-gnu /usr/lib/x86_64-linux-gnu \
    /usr/lib64 2>/dev/null | command sed -n 's/\.so.*//p'
}

_bicycle_package_names() { # ROS packages of the wheels and of this workspace
  command ls "$venv/share/ament_index/resource_index/packages" "$root/ros2_ws/src" 2>/dev/null
}
