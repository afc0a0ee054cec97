# shellcheck shell=bash disable=SC2154 # ws, venv, log, native and cpp are the caller's
# The build of setup.sh: colcon over src, apart where CMake cannot take the path. Sourced.

build() { # [SET]: builds in place, so that Python packages run from their sources; installs SET meanwhile
  if [[ -z $native ]]; then
    export AMENT_PREFIX_PATH=$venv LD_LIBRARY_PATH=$venv/lib PATH=$venv/bin:$PATH VIRTUAL_ENV=$venv
  fi
  # Generators and colcon's helpers start dozens of times: what they import need be compiled once.
  unset PYTHONDONTWRITEBYTECODE
  # Without it colcon adds -l: a busy machine would compile one file at a time.
  export MAKEFLAGS=${MAKEFLAGS:--j$(nproc)}
  cd "$ws" || exit
  if [[ -z ${1:-} ]]; then
    stage "building the workspace" cmake build_packages
  else
    stage "Python packages: $1, building the workspace" cmake beside "$1" build_packages
  fi
}

build_packages() { # Everything in src
  if path_is_plain "$ws"; then
    colcon_build "$venv" --base-paths src --symlink-install
  else
    build_messages_apart && colcon_build "$venv" --base-paths src --symlink-install \
      --packages-skip tf2_msgs bicycle_msgs
  fi
}

path_is_plain() { # PATH: whether CMake and the generators take it: ASCII letters and digits, and not too long
  local LC_ALL=C
  [[ $1 == /* && $1 != *[!A-Za-z0-9/_.-]* ]] && ((${#1} <= 150))
}

build_messages_apart() ( # Builds tf2_msgs and bicycle_msgs in a folder whose path is plain and copies them here
  apart=$(plain_folder) ||
    { echo "No folder for temporary files has a plain path; set TMPDIR to one of letters and digits." && exit 1; }
  trap 'rm -rf "$apart"' EXIT
  trap 'exit 143' TERM
  mkdir "$apart/src" && cp -RL "$ws"/src/{tf2,bicycle}_msgs "$apart/src/" && ln -s "$venv" "$apart/venv" || exit
  [[ -n $native ]] || export AMENT_PREFIX_PATH=$apart/venv
  colcon_build "$apart/venv" --base-paths "$apart/src" --build-base "$apart/build" \
    --install-base "$apart/install" || exit
  rm -rf "$ws"/install/{tf2,bicycle}_msgs && cp -R "$apart"/install/{tf2,bicycle}_msgs "$ws/install/" || exit
  grep -rlIF "$apart/install" "$ws"/install/{tf2,bicycle}_msgs | while read -r file; do # colcon's scripts name their place
    text=$(<"$file") && printf '%s\n' "${text//"$apart/install"/"$ws/install"}" >"$file"
  done
)

plain_folder() { # Makes a private folder for temporary files whose path is plain; prints it
  local parent
  for parent in "${TMPDIR:-/tmp}" /tmp /var/tmp /dev/shm; do
    path_is_plain "$parent" && mktemp -d "$parent/bicycle-build.XXXXXX" 2>/dev/null && return
  done
  return 1
}

colcon_build() { # VENV OPTION...: with ROS 2 from VENV, or the native one
  local cmake=(-DCMAKE_BUILD_TYPE=Release -DBUILD_TESTING=OFF) colcon=(colcon)
  if [[ -z $native ]]; then
    # Not by its script: the first line of that cannot name every path.
    colcon=("$venv/bin/python" -c 'import sys; from colcon_core.command import main; sys.exit(main())')
    # The wheels hold no C++ program that could use the messages; for C++ they take half as long again.
    cmake+=(-G Ninja "-DPYTHON_ONLY=$([[ -n ${cpp:-} ]] && echo OFF || echo ON)" "-DCMAKE_PREFIX_PATH=$1" "-DPython3_EXECUTABLE=$1/bin/python")
  fi
  "${colcon[@]}" --log-base /dev/null build "${@:2}" \
    --event-handlers console_direct+ console_cohesion- status- --cmake-args "${cmake[@]}"
}

beside() { # SET COMMAND...: installs packages that the command does without, as it goes
  local set=$1 installing
  shift
  (
    unset AMENT_PREFIX_PATH LD_LIBRARY_PATH
    for name in $(locks "$set"); do install_lock "$name" || exit; done
  ) >"$log.$set" 2>&1 &
  installing=$!
  "$@" || { kill "$installing" 2>/dev/null || true; return 1; }
  local status=0
  wait "$installing" || status=$?
  cat "$log.$set" && rm "$log.$set" # into the stage's own log, behind the command's
  return "$status"
}
