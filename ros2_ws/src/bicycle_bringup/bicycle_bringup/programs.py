"""The programs of this package, for its console scripts; see `bicycle_sim.early`."""

from functools import partial

from bicycle_sim.early import run_module

ride = partial(run_module, "bicycle_bringup.nodes.ride")
report = partial(run_module, "bicycle_bringup.ride_page.command")
foxglove = partial(run_module, "bicycle_bringup.nodes.foxglove_server")
goal = partial(run_module, "bicycle_bringup.nodes.goal")
topic = partial(run_module, "bicycle_bringup.nodes.topic")
verify = partial(run_module, "bicycle_bringup.nodes.verify")
