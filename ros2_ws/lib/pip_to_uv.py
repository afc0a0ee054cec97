"""Print pip's settings (files and PIP_ variables) as uv's variables, one NAME=VALUE a line.

uv reads none of pip's. Exit status 1 where one has no counterpart here: then pip must do it.
"""

from __future__ import annotations

import subprocess
import sys

NAMES = {
    "index-url": "UV_DEFAULT_INDEX",
    "extra-index-url": "UV_INDEX",
    "find-links": "UV_FIND_LINKS",
    "no-index": "UV_NO_INDEX",
    "cert": "SSL_CERT_FILE",
    "default-timeout": "UV_HTTP_TIMEOUT",
    "timeout": "UV_HTTP_TIMEOUT",
}
HARMLESS = {"disable-pip-version-check", "no-input", "progress-bar", "cache-dir", "no-cache-dir"}
HARMLESS |= {"root-user-action", "quiet", "verbose", "break-system-packages", "require-virtualenv"}
HARMLESS |= {"constraint"}  # the locks name every version
HARMLESS |= {"user", "target", "prefix", "root"}  # it goes into the virtual environment
PLACES = ("global", "install", ":env:")
LISTS = {"UV_INDEX": " ", "UV_FIND_LINKS": ","}


def main() -> int:
    """Translate; of one setting in several places the last of PLACES wins, as with pip."""
    listed = subprocess.run(
        [sys.executable, "-m", "pip", "config", "list"], capture_output=True, text=True
    )
    settings = []
    for line in listed.stdout.splitlines():
        place, _, value = line.partition("=")
        section, _, name = place.rpartition(".")
        if section not in PLACES or name in HARMLESS:
            continue
        if name not in NAMES:
            return 1
        settings.append((PLACES.index(section), NAMES[name], value.strip("'\"")))
    found = {name: value for _, name, value in sorted(settings)}
    for name, value in found.items():
        print(f"{name}={LISTS.get(name, ' ').join(value.split())}")
    # As pip does it: the best version of all indexes, whichever comes first.
    print("UV_INDEX_STRATEGY=unsafe-best-match")
    return listed.returncode


if __name__ == "__main__":
    sys.exit(main())
