"""Programs of this package, for its console scripts; see `bicycle_common.signals`."""

from functools import partial

from bicycle_common.signals import run_module

controller = partial(run_module, "bicycle_controller.nodes.controller_node")
trainer = partial(run_module, "bicycle_controller.nodes.trainer_node")
bicycle = partial(run_module, "bicycle_controller.cli.main")
