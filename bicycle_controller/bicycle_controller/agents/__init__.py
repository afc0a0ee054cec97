"""The learning algorithms: losses and update rules, no files and no simulator."""
