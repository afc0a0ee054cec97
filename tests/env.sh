# The environment of ros2_ws/env.sh, and the helpers of the tests beside it: to be sourced by bash before a
# tool of tests/tools or a benchmark of tests/benchmarks is run.
# shellcheck source-path=SCRIPTDIR source=../ros2_ws/env.sh
. "$(CDPATH='' builtin cd -P "$(dirname "${BASH_SOURCE[0]}")/.." && builtin pwd)/ros2_ws/env.sh"
_bicycle_tests=$(CDPATH='' builtin cd -P "$(dirname "${BASH_SOURCE[0]}")" && builtin pwd)
export PYTHONPATH=$_bicycle_tests/support:$_bicycle_tests/tools${PYTHONPATH:+:$PYTHONPATH}
unset _bicycle_tests
