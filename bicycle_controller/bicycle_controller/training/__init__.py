"""Training runs: collecting, learning, checkpoints, logs and sweeps."""
