"""Command `bicycle`, one module per subcommand."""
