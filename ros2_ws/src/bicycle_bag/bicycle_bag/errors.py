"""The one error of this package."""


class BagError(Exception):
    """A bag that cannot be read or written; its text is one line and names the remedy."""
