"""The learning process of the trainer node, and its client."""
