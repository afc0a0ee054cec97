#!/usr/bin/env bash
# The name of record_and_learn.sh in release 0.1.0; takes the same options.
set -euo pipefail
echo "circle.sh is called record_and_learn.sh now" >&2
exec "$(CDPATH='' builtin cd -P "$(dirname "$(readlink -f "${BASH_SOURCE[0]}")")" && builtin pwd)/record_and_learn.sh" "$@"
