"""Trained actors: their files, their inference, their exports."""
