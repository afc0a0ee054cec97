"""Simulation over time: simulator, loop, pacing, and validation of commands and pushes."""
