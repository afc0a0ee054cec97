"""Makes MCAP files of a bag that rosbag2 recorded as SQLite databases (`.db3`)."""

from __future__ import annotations

import contextlib
import os
import shutil
import sqlite3
import tempfile
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from urllib.parse import quote

import zstandard

from bicycle_bag.errors import BagError
from bicycle_bag.folder import visible
from bicycle_bag.mcap_file import McapFile
from bicycle_bag.message_packing import MARK, unpack
from bicycle_bag.metadata import BagMetadata, Topic
from bicycle_bag.qos import parse_profiles
from bicycle_bag.schemas import Schemas

SUFFIX = ".db3"
MOST_TOPICS = 65_535
_JOURNAL = "-journal"
"""Suffix of what SQLite undoes a change with."""
_WANTED = {
    "topics": ("id", "name", "type", "serialization_format"),
    "messages": ("id", "topic_id", "timestamp", "data"),
}
"""Columns of each table that every version of rosbag2 has written."""


def convert_files(path: Path) -> list[Path]:
    """Lay a `.mcap` beside each `.db3` of a bag, which stays, unless it is there.

    Args:
        path: Bag directory, or one database.

    Returns:
        The new files.

    Raises:
        BagError: One is corrupt or foreign, or the disk does not take it.
    """
    try:
        single = path.suffix == SUFFIX and path.is_file()
        found = [path] if single else visible(path, SUFFIX)
    except (OSError, ValueError):  # a name that is too long, or no name
        return []
    targets = []
    for database in found:
        target = database.with_suffix(".mcap")
        if os.path.lexists(target):
            continue
        scratch = database.with_name(f".{target.name}.repair")
        try:
            scratch.unlink(missing_ok=True)
            _convert(database, scratch, target.name)
            scratch.replace(target)
        except sqlite3.Error as error:
            raise BagError(
                f"cannot read {database} ({error}): take another copy of it, or .recover of the "
                "program sqlite3 may save a part"
            ) from None
        except OSError as error:
            raise BagError(
                f"cannot convert {database} ({error.strerror}): free some space and check the "
                "rights"
            ) from None
        finally:
            scratch.unlink(missing_ok=True)
        targets.append(target)
    return targets


@contextlib.contextmanager
def _opened(database: Path) -> Iterator[sqlite3.Connection]:
    """Yield the database, as it was before a change that its recorder did not end.

    The journal of such a change can only be undone in a database that may be written, so that
    this is a copy.
    """
    with contextlib.ExitStack() as stack:
        path, mode = database.resolve(), "ro"
        journal = path.with_name(path.name + _JOURNAL)
        if journal.is_file() and journal.stat().st_size:
            folder = tempfile.TemporaryDirectory(prefix=".repair-", dir=database.parent)
            copy = Path(stack.enter_context(folder)) / "copy.db3"
            shutil.copyfile(path, copy)
            shutil.copyfile(journal, copy.with_name(copy.name + _JOURNAL))
            path, mode = copy, "rw"
        uri = f"file:{quote(str(path))}?mode={mode}"
        yield stack.enter_context(contextlib.closing(sqlite3.connect(uri, uri=True)))


def _convert(database: Path, scratch: Path, name: str) -> None:
    """Write the messages of a database, in recorded order, into a new MCAP file."""
    with _opened(database) as source:
        source.execute("PRAGMA trusted_schema = OFF")
        (verdict,) = source.execute("PRAGMA quick_check(1)").fetchone()
        if verdict != "ok":
            raise sqlite3.DatabaseError(" ".join(str(verdict).split())[:100])
        tables = _tables(database, source)
        topics, definitions = _topics(database, source, tables)
        file = McapFile(scratch)
        try:
            for number, topic in topics.items():
                file.add_topic(topic, definitions[number])
            for number, time, data in _messages(database, source, topics):
                file.add_message(topics[number].name, data, time, time)
            about = replace(file.information, path=name)
            file.add_metadata(BagMetadata(tuple(topics.values()), dict(file.counts), (about,)))
            file.finish()
        finally:
            file.abandon()


def _tables(database: Path, source: sqlite3.Connection) -> dict[str, set[str]]:
    """Return the columns of each table; views, which could be anything, do not count."""
    names = source.execute("SELECT name FROM sqlite_master WHERE type = 'table'").fetchall()
    tables = {
        str(name): {
            str(row[0]) for row in source.execute("SELECT name FROM pragma_table_info(?)", (name,))
        }
        for (name,) in names
    }
    if any(not tables.get(name, set()).issuperset(columns) for name, columns in _WANTED.items()):
        raise BagError(f"{database} is a database, but no bag: name a file that rosbag2 recorded")
    return tables


def _topics(
    database: Path, source: sqlite3.Connection, tables: dict[str, set[str]]
) -> tuple[dict[int, Topic], dict[int, str]]:
    """Return topics and their types' definitions by the topics' numbers."""
    known = tables["topics"]
    columns = ["id", "name", "type", "serialization_format"]
    columns += [
        name if name in known else "''"
        for name in ("offered_qos_profiles", "type_description_hash")
    ]
    recorded = {}
    if tables.get("message_definitions", set()) >= {"topic_type", "encoded_message_definition"}:
        recorded = dict(
            source.execute(
                "SELECT topic_type, encoded_message_definition FROM message_definitions "
                "WHERE encoding = 'ros2msg'"
            )
        )
    (count,) = source.execute("SELECT count(*) FROM topics").fetchone()
    if count > MOST_TOPICS:
        raise BagError(
            f"{database} has {count} topics, and an MCAP file has {MOST_TOPICS} at most"
        )
    topics, definitions, schemas = {}, {}, Schemas()
    for row in source.execute(f"SELECT {', '.join(columns)} FROM topics ORDER BY id"):
        number, name, kind, encoding, offered, type_hash = row
        if not all(isinstance(text, str) for text in (name, kind, encoding, type_hash)):
            raise BagError(f"{database} names a topic that is no text: take another copy of it")
        topics[number] = Topic(name, kind, parse_profiles(offered), type_hash, encoding)
        definitions[number] = str(recorded.get(kind) or "")
        if not definitions[number]:
            with contextlib.suppress(BagError):  # of a type that is not installed here
                definitions[number] = schemas.definition(kind)
    return topics, definitions


def _messages(
    database: Path, source: sqlite3.Connection, topics: dict[int, Topic]
) -> Iterator[tuple[int, int, bytes]]:
    """Yield topic's number, ns and bytes of each message in recorded order."""
    for number, topic, time, data in source.execute(
        "SELECT id, topic_id, timestamp, data FROM messages ORDER BY id"
    ):
        if topic not in topics or not isinstance(time, int) or not isinstance(data, bytes):
            raise BagError(
                f"message {number} of {database} has no topic, no time or no bytes: take another "
                "copy of it"
            )
        yield topic, time, _unpacked(database, data)


def _unpacked(database: Path, data: bytes) -> bytes:
    """Return a message; unpack one that was compressed alone (`--compression-mode message`)."""
    if not data.startswith(MARK):
        return data
    try:
        return unpack(data)
    except zstandard.ZstdError as error:
        raise BagError(
            f"cannot unpack a message of {database} ({error}): take another copy of it"
        ) from None
