"""What all packages share: types, conventions, validation, and the plumbing of nodes."""
