"""`report.sh`: one bag, or two side by side, as an HTML page and a picture."""

from __future__ import annotations

if __name__ == "__main__":
    from bicycle_common.signals import run_module

    run_module("bicycle_tools.report_page.command")

import argparse
import sys
from collections.abc import Callable, Sequence
from os.path import realpath  # unlike `Path.resolve` it raises nothing on links in a circle
from pathlib import Path

import numpy as np

from bicycle_bag.errors import BagError
from bicycle_common.command_line import OneLineParser
from bicycle_common.progress import ProgressBar
from bicycle_tools.report_page import drawing_files
from bicycle_tools.report_page.loading import RidePage, load
from bicycle_tools.report_page.page import html, title_of

INTERRUPTED = 130


def parse(arguments: Sequence[str] | None = None) -> argparse.Namespace:
    """Read the command line; on an error end the program with status 2 and one line."""
    parser = OneLineParser(prog="report.sh", add_help=False, allow_abbrev=False)
    parser.add_argument("bags", nargs="+", type=Path)
    parser.add_argument("--output", type=Path)
    parser.add_argument("--png", action="store_true")
    parser.add_argument("--namespace")
    options, ros = parser.parse_with_ros(sys.argv[1:] if arguments is None else arguments)
    if ros:
        parser.error("this is no node: ROS arguments do nothing here; --namespace names a bicycle")
    if len(options.bags) > 2:
        parser.error(f"{len(options.bags)} bags do not fit on a page: name one or two")
    if options.output is not None and options.output.suffix != ".html":
        parser.error(f"--output is {options.output}: name a file that ends in .html")
    return options


def names_of(paths: Sequence[Path]) -> list[str]:
    """Return short names of some bags: the shortest ends of their paths that differ."""
    parts = [[part for part in Path(realpath(path)).parts if part != "/"] for path in paths]
    for count in range(1, 1 + max(map(len, parts))):
        names = ["/".join(part[-count:]) for part in parts]
        if len(set(names)) == len(names) and "bag" not in names:
            return names
    return [f"{path} ({number})" for number, path in enumerate(paths, 1)]


def output_of(paths: Sequence[Path], names: Sequence[str]) -> Path:
    """Return the default path of the page, beside the first bag."""
    words = "-and-".join(name.removesuffix(".mcap").replace("/", "-") for name in names)
    return Path(realpath(paths[0])).parent / f"{words}-report.html"


@np.errstate(invalid="ignore", over="ignore")
def report(options: argparse.Namespace) -> list[Path]:
    """Write the page, and the picture on request.

    Returns:
        The files.

    Raises:
        BagError: if a bag cannot be read or a file cannot be written.
    """
    names = names_of(options.bags)
    output = options.output or output_of(options.bags, names)
    if not output.parent.is_dir():
        raise BagError(f"there is no folder {output.parent}: choose another --output")
    stages = len(names) + len(drawing_files.DRAWINGS) + int(options.png)
    with ProgressBar(total=stages, leave=False, unit="part") as bar:
        pages: list[RidePage] = []
        for path, name in zip(options.bags, names, strict=True):
            bar.set_description(f"reading {name}")
            pages.append(load(path, name, options.namespace))
            bar.update()
        bar.set_description("drawing")
        text = html(pages, bar.update)
        written = [_write(output, lambda path: path.write_text(text, encoding="utf-8"))]
        if options.png:
            title = title_of(pages)
            picture = output.with_suffix(".png")
            written.append(_write(picture, lambda path: drawing_files.png(path, title, pages)))
            bar.update()
    return written


def _write(path: Path, write: Callable[[Path], object]) -> Path:
    """Write a file atomically."""
    scratch = path.with_name(f".{path.name}.new")
    try:
        write(scratch)
        scratch.replace(path)
    except OSError as error:
        raise BagError(
            f"cannot write {path} ({error.strerror}): choose another --output"
        ) from None
    finally:
        scratch.unlink(missing_ok=True)
    return path


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command; return its exit status."""
    options = parse(arguments)
    try:
        for path in report(options):
            print(path)
    except BagError as error:
        print(f"report.sh: {error}", file=sys.stderr)
        return 1
    except OSError as error:  # for example, a name too long for the system
        print(f"report.sh: cannot open a bag ({error.strerror})", file=sys.stderr)
        return 1
    except KeyboardInterrupt:
        print("report.sh: interrupted; nothing was written", file=sys.stderr)
        return INTERRUPTED
    return 0
