"""Rollouts of a controller and their scores, tables and model cards."""
