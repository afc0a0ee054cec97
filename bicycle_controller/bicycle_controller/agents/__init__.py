"""Learning algorithms: losses and update rules, without files or a simulator."""
