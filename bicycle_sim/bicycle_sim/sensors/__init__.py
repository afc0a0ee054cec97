"""Sensors of a bicycle: what they measure of its state, their delays and their errors."""
