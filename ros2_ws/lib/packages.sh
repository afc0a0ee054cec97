# shellcheck shell=bash disable=SC2154 # ws and venv are the caller's
# How setup.sh installs Python packages: what a lock names, checked against the hashes there. Sourced.

locks() { # SET: the names of the locks that it is installed from, in order
  case $1 in train | dev | bench) echo torch ;; esac
  echo "$1"
}

install_set() { # SET: one stage for each of its locks
  local name
  for name in $(locks "$1"); do
    stage "Python packages: $name" "pip:$(grep -c '^[a-z].*==' "$ws/requirements/$name.lock")" install_lock "$name"
  done
}

install_lock() { # NAME: what a lock names and nothing else, each file with one of the hashes that stand there
  install --no-deps --require-hashes -r "$ws/requirements/$1.lock" || return
  [[ $1 != torch ]] || has_torch_without_cuda || install_lock torch-cuda
}

has_torch_without_cuda() {
  "$venv/bin/python" -c 'import sys, importlib.metadata as m; sys.exit("+cpu" not in m.version("torch"))'
}

install() { # pip's words: with uv, which fetches many at once, or with pip where uv cannot
  local pip settings bytecode=()
  find_pip
  pip+=(install --no-input --disable-pip-version-check --progress-bar off)
  if settings=$("${pip[0]}" "$ws/lib/pip_to_uv.py") && { [[ -x $venv/bin/uv ]] ||
    "${pip[@]}" --only-binary :all: --no-deps --require-hashes -r "$ws/requirements/uv.lock"; }; then
    mapfile -t settings <<<"$settings"
    # uv leaves the compiling to the first import, which may not keep it here: then each start compiles anew.
    [[ -z ${PYTHONDONTWRITEBYTECODE:-} ]] || bytecode=(--compile-bytecode)
    (cd "$ws" && env "${settings[@]}" "$venv/bin/uv" pip install --python "$venv/bin/python" "${bytecode[@]}" "$@") && return
    echo "uv could not; now with pip."
  fi
  "${pip[@]}" "$@"
}

find_pip() { # Sets pip: the environment's, that of the Python it is made with, or a new one, which takes a while
  pip=("$venv/bin/python" -m pip)
  ! "${pip[@]}" --version || return 0
  pip=("$("$venv/bin/python" -c 'import sys; print(sys._base_executable)')" -m pip --python "$venv/bin/python")
  ! "${pip[@]}" --version || return 0
  "$venv/bin/python" -m ensurepip
  pip=("$venv/bin/python" -m pip)
}
