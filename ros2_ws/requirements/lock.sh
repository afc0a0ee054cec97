#!/usr/bin/env bash
# Resolves the *.in files again into the committed *.lock files; needs uv (pip install uv).
# Newer versions are taken with: lock.sh --upgrade
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")"
for set in build ride foxglove train dev bench; do
  # Every set is built on the one before, so that one environment can hold them all.
  uv pip compile --quiet --universal --python-version 3.10 --override overrides.in \
    --no-emit-package torch "$set.in" -o "$set.lock" "$@"
done
