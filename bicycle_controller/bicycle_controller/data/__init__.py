"""Transitions: replay buffers, data sets, and their extraction from bags."""
