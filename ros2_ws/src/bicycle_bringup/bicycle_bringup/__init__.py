"""Starts rides, sends goals, and sums up, draws and verifies what a bag holds."""
