"""Estimation: what a bicycle does, from what its sensors say."""
