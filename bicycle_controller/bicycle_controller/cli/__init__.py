"""The command `bicycle`, one module a command."""
