"""Shared by all packages: types, conventions, validation, and the plumbing of nodes."""
