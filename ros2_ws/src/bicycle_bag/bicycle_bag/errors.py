"""The errors of this package."""

from bicycle_common.validation import one_line


class BagError(Exception):
    """A bag that cannot be read or written; its text is one line and names the remedy."""

    def __init__(self, text: str = "") -> None:
        super().__init__(one_line(text))


class OptionError(BagError):
    """A value of an option that cannot be; programs end with status 2."""
