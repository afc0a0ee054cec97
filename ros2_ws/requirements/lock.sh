#!/usr/bin/env bash
# Resolves the *.in files again into the committed *.lock files, each package with the SHA-256 of its files.
#
# Usage: lock.sh [--upgrade]      from PyPI alone; needs uv (. env.sh has it, or pip install uv)
#
#   --upgrade   take newer versions; without it only what changed in *.in changes in the locks
#
# torch has two locks of its own: torch.lock, and torch-cuda.lock for what PyPI's wheel needs besides.
# torch-wheels.sha256 has the wheels that are on PyTorch's own index; a wheel that no lock names is
# refused, so for another one (CUDA of another version, say) add its SHA-256 there and call this.
set -euo pipefail
cd "$(CDPATH='' builtin cd -P "$(dirname "${BASH_SOURCE[0]}")" && builtin pwd)"

lock() { # SET ARGUMENT...
  # The machine's own indexes and wheels would give the hashes of files that nobody else has.
  env -u UV_INDEX -u UV_FIND_LINKS -u UV_CONSTRAINT UV_CUSTOM_COMPILE_COMMAND=ros2_ws/requirements/lock.sh \
    uv pip compile --quiet --no-config --universal --python-version 3.10 --no-python-downloads \
    --default-index https://pypi.org/simple --generate-hashes "$1.in" -o "$1.lock" "${@:2}"
}

lock uv "$@"
lock build --override overrides.in "$@"
last=build
for set in ride foxglove train dev bench; do
  # Within what the one before has, so that one environment can hold them all.
  lock "$set" -c "$last.lock" --override overrides.in --no-emit-package torch "$@"
  last=$set
done
lock torch -c dev.lock "$@"
lock sbom -c dev.lock "$@"
cuda='^(cuda-|nvidia-|triton)'
awk -v cuda="$cuda" '/^[^ #]/ { inside = $0 ~ cuda } inside || /^# This file/' torch.lock >torch-cuda.lock
# uv keeps the hashes that the lock has already: only the others are added.
wheels=$(grep -o '^[0-9a-f]\{64\}' torch-wheels.sha256 | while read -r sum; do
  grep -q "$sum" torch.lock || printf '    --hash=sha256:%s \\\n' "$sum"
done)
wheels=$wheels awk -v cuda="$cuda" '
  /^[^ #]/ { inside = $0 ~ cuda }
  !inside
  /^torch==/ && ENVIRON["wheels"] { print ENVIRON["wheels"] }
' torch.lock >torch.lock.new
mv torch.lock.new torch.lock
