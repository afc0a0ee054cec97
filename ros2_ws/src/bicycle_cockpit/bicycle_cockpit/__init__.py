"""The bicycle in the browser."""
