"""Learning process of the trainer node, and its client."""
