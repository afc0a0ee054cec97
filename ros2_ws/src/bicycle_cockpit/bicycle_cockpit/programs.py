"""Programs of this package, for its console scripts; see `bicycle_common.signals`."""

from functools import partial

from bicycle_common.signals import run_module

cockpit = partial(run_module, "bicycle_cockpit.nodes.cockpit")
