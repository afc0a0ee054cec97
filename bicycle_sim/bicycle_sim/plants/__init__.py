"""Plants: the bicycles that the task, the simulator and the controllers use."""
