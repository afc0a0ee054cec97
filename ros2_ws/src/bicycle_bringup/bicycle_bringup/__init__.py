"""Starts rides and sums up their bags."""
