# shellcheck shell=bash disable=SC2154,SC2034 # ws, venv, force and aside are the caller's; it reads native
# The stages of setup.sh: what the machine must have, what is done already, and progress. Sourced.
# The caller sets: ws, venv, force, aside.

log=$ws/log/setup.log
stages=0
python=
native=

check_path() { # PATH and LD_LIBRARY_PATH cannot hold some characters, colcon's scripts not others
  local root
  root=$(dirname "$ws")
  [[ $root != *[:\;\$\`\"{}[:cntrl:]]* ]] ||
    die 3 "the path $(printf %q "$root") holds a character that ROS's tools cannot take (one of : ; \$ \` \" { } or a control character): rename or move the folder."
  LC_ALL=C.UTF-8 grep -qax '.*' <<<"$root" ||
    die 3 "the path $(printf %q "$root") is not UTF-8, which ROS's tools need: rename or move the folder."
}

make_folders() { # colcon looks into none of them for packages
  mkdir -p "$ws/log" "$ws/install" "$ws/build" "$ws/runs"
  touch "$ws/log/COLCON_IGNORE" "$ws/install/COLCON_IGNORE" "$ws/build/COLCON_IGNORE" "$ws/runs/COLCON_IGNORE"
}

one_at_a_time() { # A second call waits for the first; the lock goes with the process
  exec 9>"$ws/log/setup.lock"
  # Scripts that start together hold it for a moment each, to see that there is nothing to do.
  if ! flock --timeout 10 9; then
    echo "Another set-up of this workspace is running; waiting for it."
    flock 9
  fi
}

find_native() { # Sets native where ROS 2 Jazzy from apt is sourced
  case ":${AMENT_PREFIX_PATH:-}:" in
    *:/opt/ros/jazzy:*) native=yes ;;
    *:/opt/ros/*) die 3 "ROS 2 '${ROS_DISTRO:-}' is sourced, but this needs jazzy (or none): open a fresh shell." ;;
    *) unset AMENT_PREFIX_PATH ;;
  esac
}

check_native() { # The Python packages that apt's ROS 2 does not bring
  local missing
  missing=$(python3 - <<'PYTHON'
from importlib.util import find_spec
names = {"colcon": "colcon-common-extensions", "mcap": "mcap", "mcap_ros2": "mcap-ros2-support",
         "safetensors": "safetensors", "aiohttp": "aiohttp", "scipy": "scipy", "matplotlib": "matplotlib", "tqdm": "tqdm", "yaml": "pyyaml"}
print(*(package for module, package in names.items() if find_spec(module.split(".")[0]) is None))
PYTHON
)
  [[ -z $missing ]] ||
    die 3 "missing Python packages: $missing. Install: python3 -m pip install --user --break-system-packages $missing"
}

find_python() { # Sets python to an interpreter of a version that the wheels exist for
  local candidate
  for candidate in ${PYTHON:+"$PYTHON"} python3 python3.12 python3.13 python3.11 python3.10; do
    if "$candidate" -c 'import sys; sys.exit(not (3, 10) <= sys.version_info[:2] <= (3, 13))' 2>/dev/null; then
      python=$candidate
      return 0
    fi
    [[ -z ${PYTHON:-} ]] || break
  done
  return 1
}

check_system() { # Everything that is missing, at once, with the command that brings it
  local missing=() packages=() version
  [[ $(uname -sm) == "Linux x86_64" ]] ||
    die 3 "this needs Linux on x86-64 (here: $(uname -sm)); elsewhere use Docker, see docker/, or a native ROS 2 Jazzy."
  if [[ ! -x $venv/bin/python ]]; then
    if ! find_python; then
      missing+=("Python 3.10 to 3.13 (${PYTHON:-python3} is $("${PYTHON:-python3}" -V 2>/dev/null || echo missing))")
      packages+=(python3 python3-venv python3-dev)
    else
      version=$("$python" -c 'import sys; print("python%d.%d" % sys.version_info[:2])')
      "$python" -c 'import venv, ensurepip' 2>/dev/null ||
        { missing+=("Python's venv module") && packages+=("$version-venv"); }
      [[ -f $("$python" -c 'import sysconfig; print(sysconfig.get_path("include"))')/Python.h ]] ||
        { missing+=("Python's C headers") && packages+=("$version-dev"); }
    fi
  fi
  have c++ || have g++ || { missing+=("a C++ compiler") && packages+=(g++); }
  have make || have ninja || { missing+=(make) && packages+=(make); }
  have cmake || { missing+=(CMake) && packages+=(cmake); }
  ((${#missing[@]} == 0)) ||
    die 3 "missing on this machine: $(join ', ' "${missing[@]}"). On Debian or Ubuntu: sudo apt-get install -y ${packages[*]}"
}

fingerprint() { # FILE...: one hash over the names and contents
  sha256sum -- "$@" | sha256sum | cut -d' ' -f1
}

build_inputs() { # The fingerprint of all that decides what colcon builds
  local files
  files=$(
    cd "$ws" || exit
    find -L src -path '*/.*' -prune -o -type f \( -path '*_msgs/*' -o -name package.xml -o -name setup.py \
      -o -name setup.cfg -o -name '*.cpp' -o -name '*.h' -o -path '*/native/build.py' \) -print | LC_ALL=C sort
  )
  {
    (cd "$ws" && xargs -d '\n' sha256sum -- <<<"$files")
    (cd "$ws" && find src/bicycle_bringup/config src/bicycle_bringup/launch -type f | LC_ALL=C sort)
    cat "$ws/requirements/build.lock"
    python_in_use
    [[ -z ${cpp:-} ]] || echo C++
  } | sha256sum | cut -d' ' -f1
}

python_in_use() { # What compiled code is bound to
  if [[ -n $native ]]; then
    echo "native $(python3 -V)"
  else
    echo "$venv, built by ninja" && cat "$venv/pyvenv.cfg"
  fi
}

clean_unless_same_python() { # Starts anew after another interpreter, a moved clone or a killed build
  local note=$ws/install/.bicycle.python
  if [[ -n $force || $(cat "$ws/install/.bicycle.stamp" 2>/dev/null) == building ]] ||
    ! python_in_use | cmp -s - "$note"; then
    rm -rf "$ws/build" "$ws/install"
    make_folders
  fi
  python_in_use >"$note"
}

is_done() { # STAMP INPUTS: whether the stage was finished with these inputs
  [[ -z $force && -f $1 && $(<"$1") == "$2" ]]
}

mark() { # STAMP INPUTS
  printf '%s\n' "$2" >"$1.new"
  mv "$1.new" "$1"
}

progress() { # COUNTER LOG-OFFSET: how far the running stage is, from what it logged so far
  local seen=
  case $1 in
    pip:*)
      seen=$(tail -c "+$2" "$log" | grep -cE '^(Collecting|Requirement already satisfied)' || true)
      if tail -c "+$2" "$log" | grep -q '^Installing collected'; then
        echo "installing ${1#pip:}"
      else
        ((seen == 0)) || echo "$seen of ${1#pip:}" # uv tells none
      fi
      ;;
    cmake) tail -c "+$2" "$log" | grep -oE '^\[ *[0-9]+(%|/[0-9]+)\]' | tail -n 1 | tr -d '[] ' || true ;;
  esac
}

stage() { # LABEL COUNTER COMMAND...: runs quietly with one line of progress; ends the script on failure
  local label=$1 counter=$2 start=$SECONDS offset status=0 line=
  shift 2
  if ((stages++ == 0)); then
    : >"$log"
    [[ -z $aside ]] || printf 'setup.sh: %s\n' "$aside" >&2
  fi
  printf '\n=== %s: %s\n' "$label" "$*" >>"$log"
  offset=$(stat -c %s "$log")
  [[ -t 1 ]] || printf '%s ... ' "$label"
  set -m # an own process group, so that an interrupt ends the whole stage
  "$@" >>"$log" 2>&1 </dev/null &
  local pid=$!
  set +m
  # shellcheck disable=SC2064 # the pid of now
  trap "kill -TERM -- -$pid 2>/dev/null; wait $pid || true; echo; die 130 'interrupted; call again to go on.'" INT TERM
  while kill -0 "$pid" 2>/dev/null; do
    if [[ -t 1 ]]; then
      line="$label ... $(progress "$counter" "$offset") $((SECONDS - start)) s"
      printf '\r\033[K%s' "$line"
    fi
    sleep 0.2
  done
  wait "$pid" || status=$?
  end_on_signals
  [[ ! -t 1 ]] || printf '\r\033[K%s ... ' "$label"
  if ((status)); then
    echo "failed"
    tail -n 15 "$log" >&2
    die 1 "$label failed (exit status $status); the whole log is $log"
  fi
  echo "done in $((SECONDS - start)) s"
}
