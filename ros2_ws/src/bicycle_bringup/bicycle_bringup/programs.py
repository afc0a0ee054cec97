"""Program of this package, for its console script; see `bicycle_common.signals`."""

from functools import partial

from bicycle_common.signals import run_module

ride = partial(run_module, "bicycle_bringup.nodes.ride")
