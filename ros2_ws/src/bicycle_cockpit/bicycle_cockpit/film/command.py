"""`report.sh --video` and `report.sh --viewer`: rides as a film, or as a page to give away."""

from __future__ import annotations

if __name__ == "__main__":
    from bicycle_common.signals import run_module

    run_module("bicycle_cockpit.film.command")

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path

from bicycle_bag.errors import BagError
from bicycle_bag.reader import bag_in
from bicycle_cockpit.export_page import export_page
from bicycle_cockpit.film.browser import BrowserError, find_browser
from bicycle_cockpit.film.encoder import EncoderError, check_format
from bicycle_cockpit.film.maker import CAMERAS, TOUR, FilmOptions, make_film
from bicycle_common.command_line import OneLineParser
from bicycle_common.progress import ProgressBar

MOST_BAGS = 50
INTERRUPTED = 130


def _size(text: str) -> tuple[int, int]:
    width, _, height = text.partition("x")
    return int(width), int(height)


def parse(arguments: Sequence[str] | None = None) -> argparse.Namespace:
    """Read the command line; on an error end the program with status 2 and one line."""
    parser = OneLineParser(prog="report.sh", add_help=False, allow_abbrev=False)
    parser.add_argument("bags", nargs="+", type=Path)
    wanted = parser.add_mutually_exclusive_group(required=True)
    wanted.add_argument("--video", type=Path)
    wanted.add_argument("--viewer", type=Path)
    parser.add_argument("--against", default="")
    parser.add_argument("--size", type=_size)
    parser.add_argument("--fps", type=float)
    parser.add_argument("--speed", type=float)
    parser.add_argument("--from", type=float, dest="start")
    parser.add_argument("--to", type=float, dest="end")
    parser.add_argument("--camera", choices=(*CAMERAS, TOUR))
    options, ros = parser.parse_with_ros(sys.argv[1:] if arguments is None else arguments)
    if ros:
        parser.error("this is no node: ROS arguments do nothing here")
    given = {
        name: value
        for name, key in (
            ("size", "size"),
            ("rate", "fps"),
            ("speed", "speed"),
            ("start", "start"),
            ("end", "end"),
            ("camera", "camera"),
        )
        if (value := getattr(options, key)) is not None
    }
    if options.video is None and given:
        parser.error("--size, --fps, --speed, --from, --to and --camera go with --video")
    if options.video is not None and len(options.bags) > 1:
        parser.error(f"a film shows one bag, not {len(options.bags)}")
    if len(options.bags) > MOST_BAGS:
        parser.error(f"a page holds {MOST_BAGS} bags at most, not {len(options.bags)}")
    try:
        options.film = FilmOptions(**given, against=options.against)
    except ValueError as error:
        parser.error(str(error))
    return options


def video(bag: Path, film: Path, options: FilmOptions) -> None:
    """Make a film, and tell how far it is."""
    check_format(film)
    find_browser()
    with ProgressBar(leave=False, unit="picture", desc=film.name) as bar:

        def progress(done: int, wanted: int) -> None:
            bar.total = wanted
            bar.update(done - bar.n)

        make_film(bag_in(bag), film, options, progress)


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command; return its exit status."""
    options = parse(arguments)
    try:
        if options.video is not None:
            video(options.bags[0], options.video, options.film)
            print(options.video)
        else:
            options.viewer.mkdir(parents=True, exist_ok=True)
            bags = [bag_in(bag) for bag in options.bags]
            print(export_page(bags, options.viewer, against=options.against))
    except (BagError, BrowserError, EncoderError, ValueError) as error:
        print(f"report.sh: {error}", file=sys.stderr)
        return 1
    except OSError as error:
        name = f" {error.filename}" if error.filename else ""
        print(f"report.sh: cannot read or write{name} ({error.strerror})", file=sys.stderr)
        return 1
    except KeyboardInterrupt:
        print("report.sh: interrupted; nothing was written", file=sys.stderr)
        return INTERRUPTED
    return 0
