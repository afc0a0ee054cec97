"""Log lines that end, and are one line each: on screens, in files and on /rosout.

A message of 10 MB makes no line of 10 MB, and a name with a line feed or an escape sequence forges
no other line.
"""

from __future__ import annotations

from typing import Any

from rclpy.impl.implementation_singleton import rclpy_implementation

from bicycle_common.validation import one_line

LONGEST = 1000
"""Characters."""


def bound_log_lines() -> None:
    """Bound texts in the last step of rclpy's loggers, which is in C and shared by all."""
    log = rclpy_implementation.rclpy_logging_rcutils_log
    if getattr(log, "cuts", False):
        return

    def cut(severity: int, name: str, message: str, *place: Any) -> None:
        log(severity, name, shortened(message), *place)

    cut.cuts = True  # type: ignore[attr-defined]
    rclpy_implementation.rclpy_logging_rcutils_log = cut


def shortened(text: str) -> str:
    """Return a text in one line, cut to `LONGEST` characters, with a note about the rest."""
    if len(text) > LONGEST:
        end = LONGEST // 2
        text = f"{text[:end]}... ({len(text)} characters) ...{text[-end:]}"
    return one_line(text)
