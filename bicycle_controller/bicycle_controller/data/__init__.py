"""Transitions: replay buffers, datasets, and their making from bags."""
