#!/usr/bin/env bash
# Lists every Python package that is installed here, with version, licence and what needs it: a software bill
# of materials, in CycloneDX's JSON, made by cyclonedx-py.
#
# Usage: sbom.sh [--output FILE.json]
#
#   --output FILE.json   where it goes; to standard output unless named
#
# Needs cyclonedx-bom, once: setup.sh --with sbom. In a container's image the list was made with it.
# It says nothing of Debian's packages: dpkg-query --show does.
# Exit status: 0 written, 1 it could not be made, 2 bad arguments.
set -euo pipefail
ws=$(CDPATH='' builtin cd -P "$(dirname "$(readlink -f "${BASH_SOURCE[0]}")")" && builtin pwd)
# shellcheck source-path=SCRIPTDIR source=lib/common.sh
. "$ws/lib/common.sh"

! help_wanted "$@" || { usage "${BASH_SOURCE[0]}" && exit 0; }
output=-
if (($#)); then
  [[ $1 == --output && $# == 2 && -n $2 && $2 != -* ]] || die 2 "'$*' is not --output FILE.json; see sbom.sh --help."
  output=$2
fi
if [[ -f $ws/install/.bicycle.sealed ]]; then # by docker/seal.sh
  [[ $output == - ]] || exec cp "$ws/../sbom.cdx.json" "$output"
  exec cat "$ws/../sbom.cdx.json"
fi
enter_workspace
"$python" -c 'import cyclonedx_py' 2>/dev/null || die 1 "cyclonedx-bom is not installed: run setup.sh --with sbom."
[[ $output == - || -d $(dirname "$output") ]] || die 2 "no folder '$(dirname "$output")'."
exec "$python" -W ignore -m cyclonedx_py environment --pyproject "$ws/requirements/sbom.toml" --output-reproducible \
  --output-format JSON --output-file "$output" "$python"
