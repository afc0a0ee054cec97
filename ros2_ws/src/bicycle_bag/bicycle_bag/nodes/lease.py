"""Time for which other nodes wait for a silent one."""

from __future__ import annotations

import contextlib
import os
import tempfile
from collections.abc import Iterator
from pathlib import Path
from xml.etree import ElementTree

PROFILES = "FASTRTPS_DEFAULT_PROFILES_FILE"
"""Names Fast DDS's settings; `env.sh` sets it."""
SPACE = "http://www.eprosima.com/XMLSchemas/fastRTPS_Profiles"
LEASE = 60
"""s; publishers keep messages for as long, see `topics.RESEND`."""


@contextlib.contextmanager
def long_lease() -> Iterator[None]:
    """Let other nodes wait a minute for nodes created in this context when they are silent.

    A participant announces how long others wait for it. The usual 20 s remove a dead node soon,
    but publishers would also drop a recorder that is stopped for longer, for example on a machine
    that sleeps, and the messages that it has not received. Without a settings file of Fast DDS
    that has such a time, nothing changes.
    """
    given = os.environ.get(PROFILES, "")
    with contextlib.ExitStack() as stack:
        settings = _lengthened(Path(given)) if given else None
        if settings is not None:
            file = stack.enter_context(tempfile.NamedTemporaryFile(suffix=".xml"))
            file.write(settings)
            file.flush()
            os.environ[PROFILES] = file.name
            stack.callback(os.environ.__setitem__, PROFILES, given)
        yield


def _lengthened(path: Path) -> bytes | None:
    """Return the settings with a longer lease; None if they have none, or a longer one."""
    try:
        tree = ElementTree.parse(path)
    except (OSError, ElementTree.ParseError):
        return None  # Fast DDS tells of it
    steps = ("discovery_config", "leaseDuration", "sec")
    seconds = tree.findall("./" + "".join(f"/{{{SPACE}}}{step}" for step in steps))
    short = [one for one in seconds if (one.text or "").isdecimal() and int(one.text or 0) < LEASE]
    for one in short:
        one.text = str(LEASE)
    ElementTree.register_namespace("", SPACE)
    return ElementTree.tostring(tree.getroot(), encoding="utf-8") if short else None
