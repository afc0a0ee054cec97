"""Programs of this package, for its console scripts; see `bicycle_common.signals`."""

from functools import partial

from bicycle_common.signals import run_module

fleet = partial(run_module, "bicycle_bringup.nodes.fleet")
ride = partial(run_module, "bicycle_bringup.nodes.ride")
