#!/usr/bin/env bash
# Makes a workspace that setup.sh has built ready for an image: without compilers, nothing to set up.
#
# Usage: seal.sh SET...      inside the image's build, see Dockerfile; it cannot be undone
set -euo pipefail
root=$(CDPATH='' builtin cd -P "$(dirname "${BASH_SOURCE[0]}")/.." && builtin pwd)
ws=$root/ros2_ws
python=$root/.venv/bin/python

# colcon's symbolic links lead into the build folder.
find "$ws/install" -type l -lname '*/build/*' | while read -r link; do
  cp --remove-destination --recursive "$(readlink -f "$link")" "$link"
done
rm -rf "$ws/build" "$ws/log" "$ws/runs"

files=()
for set in build "$@"; do
  files+=("$ws/requirements/$set.in")
done
"$python" "$root/docker/prune.py" "${files[@]}"
find "$root" -name __pycache__ -not -path "$root/.venv/*" -prune -exec rm -rf {} +
"$python" -m compileall -q "$root/bicycle_sim" "$root/bicycle_controller" "$ws/src" "$ws/install"
/opt/sbom/bin/python -W ignore -m cyclonedx_py environment --pyproject "$ws/requirements/sbom.toml" --output-reproducible \
  --output-format JSON --output-file "$root/sbom.cdx.json" "$python"
touch "$ws/install/.bicycle.sealed"
