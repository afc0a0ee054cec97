"""The programs of this package, for its console scripts; see `bicycle_common.signals`."""

from functools import partial

from bicycle_common.signals import run_module

record = partial(run_module, "bicycle_bag.nodes.recorder_node")
play = partial(run_module, "bicycle_bag.nodes.player_node")
repair = partial(run_module, "bicycle_bag.repair")
