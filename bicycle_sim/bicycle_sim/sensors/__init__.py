"""Sensors of a bicycle: what could be measured of its state, when, and how wrongly."""
