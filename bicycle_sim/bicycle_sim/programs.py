"""The programs of this package, for its console scripts; see `bicycle_sim.early`."""

from functools import partial

from bicycle_sim.early import run_module

simulator = partial(run_module, "bicycle_sim.nodes.sim_node")
