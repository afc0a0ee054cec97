"""Plants: the bicycles that the task, the simulator and controllers can ride."""
