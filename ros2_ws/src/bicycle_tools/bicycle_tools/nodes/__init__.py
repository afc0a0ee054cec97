"""Command-line tools that talk to running nodes."""
