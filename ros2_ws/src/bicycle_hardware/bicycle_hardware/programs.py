"""Programs of this package, for its console scripts; see `bicycle_common.signals`."""

from functools import partial

from bicycle_common.signals import run_module

driver = partial(run_module, "bicycle_hardware.nodes.driver_node")
bench = partial(run_module, "bicycle_hardware.nodes.bench_node")
