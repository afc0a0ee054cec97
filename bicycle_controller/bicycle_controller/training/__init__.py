"""Training runs: collection, learning, checkpoints, logs and sweeps."""
