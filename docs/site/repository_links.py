"""Links of the pages to files outside `docs`, for the site: it holds no copy of the repository.

In the repository such a link leads to the file. On the site its text stays, with the file's path
as its title. A link to a file that does not exist is a warning, which ends a strict build.
"""

from __future__ import annotations

import logging
import posixpath
import re
from pathlib import Path
from typing import Any

LINK = re.compile(r"(?<!!)\[((?:[^\[\]]|\[[^\]]*\])+)\]\(([^)\s]+)\)")
ROOT = Path(__file__).resolve().parents[2]
LOG = logging.getLogger("mkdocs.plugins.repository_links")


def on_page_markdown(markdown: str, *, page: Any, files: Any, **_: Any) -> str:
    """Replace such links of a page; see mkdocs' hooks."""
    folder = posixpath.dirname(page.file.src_uri)
    parts = re.split(r"(^```.*?^```)", markdown, flags=re.DOTALL | re.MULTILINE)

    def replaced(match: re.Match[str]) -> str:
        text, target = match[1], match[2]
        path, _, _ = target.partition("#")
        if not path or re.match(r"[a-z]+:", target):
            return match[0]
        place = posixpath.normpath(posixpath.join("docs", folder, path))
        inside = place.removeprefix("docs/")
        if place.startswith("docs/") and files.get_file_from_path(inside) is not None:
            return match[0]
        if not (ROOT / place).exists():
            LOG.warning("%s links to %s, which does not exist", page.file.src_uri, target)
        return f'<span class="file" title="{place}">{text}</span>'

    for index in range(0, len(parts), 2):  # text outside code blocks
        parts[index] = LINK.sub(replaced, parts[index])
    return "".join(parts)


def on_post_page(output: str, **_: Any) -> str:
    """Name the theme's landmarks, which assistive technology lists."""
    named = '<div role="navigation" aria-label="Site" class="navbar'
    return output.replace('<div class="navbar', named, 1)


def on_page_content(html: str, **_: Any) -> str:
    """Turn empty header cells into plain cells; let the keyboard scroll wide tables and code."""
    html = re.sub(r"<th([^>]*)></th>", r"<td\1></td>", html)
    return re.sub(r"<(table|pre)>", r'<\1 tabindex="0">', html)
