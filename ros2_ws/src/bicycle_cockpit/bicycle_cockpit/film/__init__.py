"""Films of recorded rides."""
