"""Settings of the progress bar from the environment: those that cannot be used are set aside.

`tqdm` reads variables named `TQDM_…` when it is imported, and fails on what it cannot parse.
"""

from __future__ import annotations

import math
import os
import string
from collections.abc import MutableMapping

PREFIX = "TQDM_"
_NUMBERS = {"MININTERVAL", "MAXINTERVAL", "MINITERS", "SMOOTHING", "TOTAL", "DELAY"}
_WHOLE = {"INITIAL", "UNIT_DIVISOR", "NCOLS", "NROWS", "POSITION"}
_UNUSABLE = {"FILE", "ITERABLE", "GUI", "LOCK_ARGS"}
"""Settings that no text can have."""
_FIELDS = {
    "l_bar",
    "bar",
    "r_bar",
    "n",
    "n_fmt",
    "total",
    "total_fmt",
    "percentage",
    "elapsed",
    "elapsed_s",
    "ncols",
    "nrows",
    "desc",
    "unit",
    "rate",
    "rate_fmt",
    "rate_noinv",
    "rate_noinv_fmt",
    "rate_inv",
    "rate_inv_fmt",
    "postfix",
    "unit_divisor",
    "remaining",
    "remaining_s",
    "eta",
    "prefix",
    "bar_format",
    "colour",
}


def set_aside(environment: MutableMapping[str, str] = os.environ) -> str:
    """Remove the settings that cannot be used; return a line that names them, or nothing."""
    wrong = [
        name
        for name, value in environment.items()
        if name.startswith(PREFIX) and not _is_usable(name.removeprefix(PREFIX).upper(), value)
    ]
    said = ", ".join(f"{name}={environment.pop(name)[:40]!r}" for name in sorted(wrong))
    return f"set aside, as the progress bar cannot use it: {said}" if said else ""


def _is_usable(name: str, value: str) -> bool:
    try:
        if name in _NUMBERS:
            return math.isfinite(float(value)) and float(value) >= 0.0
        if name in _WHOLE:
            return int(value) >= (name == "UNIT_DIVISOR")
        if name == "BAR_FORMAT":
            fields = [field for _, field, _, _ in string.Formatter().parse(value)]
            return {field for field in fields if field is not None} <= _FIELDS
    except ValueError:
        return False
    return name not in _UNUSABLE
