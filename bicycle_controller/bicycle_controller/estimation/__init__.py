"""Estimation of a bicycle's state from its sensors' readings."""
