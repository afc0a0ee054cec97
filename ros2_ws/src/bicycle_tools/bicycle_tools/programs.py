"""Programs of this package, for its console scripts; see `bicycle_common.signals`."""

from functools import partial

from bicycle_common.signals import run_module

report = partial(run_module, "bicycle_tools.report_page.command")
foxglove = partial(run_module, "bicycle_tools.nodes.foxglove_server")
path = partial(run_module, "bicycle_tools.nodes.path")
teleop = partial(run_module, "bicycle_tools.nodes.teleop")
goal = partial(run_module, "bicycle_tools.nodes.goal")
topic = partial(run_module, "bicycle_tools.nodes.topic")
verify = partial(run_module, "bicycle_tools.nodes.verify")
