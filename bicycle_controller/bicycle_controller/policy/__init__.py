"""Trained actors: files, inference, export."""
