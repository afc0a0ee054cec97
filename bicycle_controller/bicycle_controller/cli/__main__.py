"""`python -m bicycle_controller.cli` is `bicycle`."""

from bicycle_common.signals import run_module

run_module("bicycle_controller.cli.main")
