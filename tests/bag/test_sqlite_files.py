"""Bags that rosbag2 recorded as SQLite databases: named with the remedy, and made into MCAP."""

from __future__ import annotations

import shutil
import sqlite3
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest
import yaml
import zstandard
from ride_bag import COMMAND, EPISODE, STATE, ride, schemas, store
from rosbags.highlevel import AnyReader
from rosbags.rosbag2 import StoragePlugin, Writer

from bicycle_bag import metadata, repair
from bicycle_bag.errors import BagError
from bicycle_bag.reader import BagReader

STEPS = 20
COUNT = 2 * STEPS + 1
TYPES = {
    STATE: "bicycle_msgs/msg/BicycleState",
    COMMAND: "bicycle_msgs/msg/BicycleCommand",
    EPISODE: "bicycle_msgs/msg/EpisodeInfo",
}


@pytest.fixture
def bag(tmp_path: Path) -> Path:
    """Return a ride that another program has recorded in a database."""
    with Writer(tmp_path / "bag", version=9, storage_plugin=StoragePlugin.SQLITE3) as writer:
        writer.set_custom_data("seed", "7")
        connections = {
            name: writer.add_connection(name, kind, typestore=store())
            for name, kind in TYPES.items()
        }
        for topic, data, now in ride(STEPS):
            writer.write(connections[topic], now, data)
    assert (tmp_path / "bag" / "bag.db3").is_file()
    return tmp_path / "bag"


def change(bag: Path, *statements: str) -> None:
    """Change the database."""
    with sqlite3.connect(bag / "bag.db3") as database:
        for statement in statements:
            database.execute(statement)
    database.close()


def contents(path: Path) -> list[tuple[str, bytes, int]]:
    return [(item.topic, item.data, item.log_time_ns) for item in BagReader(path).messages()]


def refusal(path: Path) -> str:
    with pytest.raises(BagError) as raised:
        BagReader(path)
    assert "\n" not in str(raised.value)
    return str(raised.value)


@pytest.mark.parametrize("what", ["folder", "folder without metadata", "file", "renamed"])
def test_it_is_named_with_the_remedy(bag: Path, what: str) -> None:
    path = bag
    if what != "folder":
        (bag / "metadata.yaml").unlink()
    if what == "file":
        path = bag / "bag.db3"
    if what == "renamed":
        path = (bag / "bag.db3").rename(bag / "bag.mcap")
    line = refusal(path)
    assert "stored as sqlite3, and only mcap can be read here" in line
    assert "record.sh --repair makes one of it" in line
    assert "ros2 bag convert" in line


def test_a_repair_makes_a_bag_of_it_and_keeps_the_database(
    bag: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    before = (bag / "bag.db3").read_bytes()
    assert repair.main([str(bag)]) == 0
    said = capsys.readouterr().out
    assert f"{COUNT} messages are whole" in said
    assert "made of sqlite3: bag.mcap" in said
    assert contents(bag) == ride(STEPS)
    assert (bag / "bag.db3").read_bytes() == before
    reader = BagReader(bag)
    assert reader.counts == {STATE: STEPS, COMMAND: STEPS, EPISODE: 1}
    for name, kind in TYPES.items():
        topic = reader.topics[name]
        assert (topic.type, topic.serialization_format) == (kind, "cdr")
        assert topic.type_hash == store().hash_rihs01(kind)
        assert "float64" in reader.definition(name) or name == EPISODE
    converted = metadata.read(bag)
    assert converted.message_count == COUNT
    assert converted.custom_data["seed"] == "7"
    with AnyReader([bag / "bag.mcap"]) as foreign:
        assert foreign.message_count == COUNT


def test_a_second_repair_changes_nothing(bag: Path) -> None:
    assert repair.repair(bag).converted == [bag / "bag.mcap"]
    before = {path.name: path.read_bytes() for path in bag.iterdir()}
    report = repair.repair(bag)
    assert (report.converted, report.rewritten) == ([], [])
    assert {path.name: path.read_bytes() for path in bag.iterdir()} == before


def test_a_database_alone_gets_a_file_beside_it(
    bag: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    alone = tmp_path / "wü rd?#%20.db3"
    shutil.copy(bag / "bag.db3", alone)
    assert repair.main([str(alone)]) == 0
    assert "made of sqlite3" in capsys.readouterr().out
    assert contents(alone.with_suffix(".mcap")) == ride(STEPS)


def test_one_of_an_older_release_has_the_definitions_that_are_installed(
    bag: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Up to Humble a database held no definitions, no hashes, and its numbers of columns."""
    monkeypatch.setattr("bicycle_bag.sqlite_files.Schemas", schemas)
    change(
        bag,
        "DROP TABLE message_definitions",
        "ALTER TABLE topics DROP COLUMN type_description_hash",
        "ALTER TABLE topics DROP COLUMN offered_qos_profiles",
        "UPDATE topics SET type = 'no_msgs/msg/Such' WHERE name = '/bicycle/episode'",
    )
    repair.repair(bag)
    assert contents(bag) == ride(STEPS)
    reader = BagReader(bag)
    assert reader.definition(STATE) == schemas().definition(TYPES[STATE])
    assert reader.definition(EPISODE) == ""


def test_messages_that_were_compressed_one_by_one_are_unpacked(bag: Path) -> None:
    with sqlite3.connect(bag / "bag.db3") as database:
        rows = database.execute("SELECT id, data FROM messages").fetchall()
        packed = [(zstandard.compress(data), number) for number, data in rows]
        database.executemany("UPDATE messages SET data = ? WHERE id = ?", packed)
    database.close()
    content = yaml.safe_load((bag / "metadata.yaml").read_text())
    content[metadata.ROOT].update(compression_mode="MESSAGE", compression_format="zstd")
    (bag / "metadata.yaml").write_text(yaml.safe_dump(content))
    repair.repair(bag)
    assert contents(bag) == ride(STEPS)


@pytest.mark.parametrize(
    ("statement", "said"),
    [
        ("DROP TABLE messages", "is a database, but no bag"),
        ("ALTER TABLE topics RENAME COLUMN type TO kind", "is a database, but no bag"),
        ("UPDATE messages SET topic_id = 77 WHERE id = 5", "message 5 of .* has no topic"),
        ("UPDATE messages SET timestamp = 'noon' WHERE id = 5", "message 5 of .* no time"),
        ("UPDATE messages SET data = 7 WHERE id = 5", "message 5 of .* no bytes"),
        ("UPDATE messages SET data = X'28B52FFD00' WHERE id = 5", "cannot unpack a message"),
        ("UPDATE topics SET name = X'00'", "names a topic that is no text"),
    ],
)
def test_a_foreign_database_is_one_line(bag: Path, statement: str, said: str) -> None:
    change(bag, statement)
    refused(bag, said)


def refused(bag: Path, said: str) -> None:
    """Assert that a repair tells this in one line and leaves all as it was."""
    before = {path.name: path.read_bytes() for path in bag.iterdir()}
    with pytest.raises(BagError, match=said) as raised:
        repair.repair(bag)
    assert "\n" not in str(raised.value)
    assert {path.name: path.read_bytes() for path in bag.iterdir()} == before


def test_a_view_in_place_of_messages_is_not_asked(bag: Path) -> None:
    """It could be a query without end."""
    endless = "WITH RECURSIVE n(i) AS (SELECT 1 UNION ALL SELECT i + 1 FROM n) "
    endless += "SELECT i AS id, 1 AS topic_id, i AS timestamp, X'00' AS data FROM n"
    change(bag, "DROP TABLE messages", f"CREATE VIEW messages AS {endless}")
    refused(bag, "is a database, but no bag")


@pytest.mark.parametrize("kept", [0, 8, 100, 5000, -3000])
def test_a_database_that_was_cut_off_is_one_line(bag: Path, kept: int) -> None:
    data = (bag / "bag.db3").read_bytes()
    (bag / "bag.db3").write_bytes(data[:kept])
    refused(bag, r"cannot read .*bag\.db3|is a database, but no bag")


def test_the_cockpit_lists_it_with_the_remedy(bag: Path) -> None:
    from bicycle_cockpit.shelf import BagShelf, entry

    for _ in range(2):
        ((name, path),) = BagShelf(bag.parent).found().items()
        problem: Any = entry(name, path)["problem"]
        assert "record.sh --repair makes one of it" in problem or "written" in problem
        (bag / "metadata.yaml").unlink(missing_ok=True)


def test_more_topics_than_a_file_may_have_are_one_line(bag: Path) -> None:
    many = "WITH RECURSIVE n(i) AS (SELECT 10 UNION ALL SELECT i + 1 FROM n LIMIT 65600) "
    kind = "'std_msgs/msg/String', 'cdr', '', '' FROM n"
    change(bag, f"INSERT INTO topics {many} SELECT i, '/t' || i, {kind}")
    with pytest.raises(BagError, match="topics, and an MCAP file has 65535 at most"):
        repair.repair(bag)


KILLED_IN_A_CHANGE = """
import os, sqlite3, sys
database = sqlite3.connect(sys.argv[1], isolation_level=None)
database.execute("PRAGMA cache_size = 1")
database.execute("BEGIN")
for number in range(2000):
    database.execute(
        "INSERT INTO messages(topic_id, timestamp, data) VALUES(1, ?, ?)", (number, bytes(500))
    )
os.kill(os.getpid(), 9)
"""


@pytest.mark.parametrize("single", [True, False])
def test_a_change_that_a_killed_recorder_did_not_end_is_undone(bag: Path, single: bool) -> None:
    database, journal = bag / "bag.db3", bag / "bag.db3-journal"
    with sqlite3.connect(database) as opened:
        opened.execute("PRAGMA journal_mode = DELETE")
    opened.close()
    subprocess.run([sys.executable, "-c", KILLED_IN_A_CHANGE, database], check=False)
    assert journal.stat().st_size
    before = database.read_bytes(), journal.read_bytes()
    repair.repair(database if single else bag)
    assert contents(bag / "bag.mcap") == ride(STEPS)
    assert before == (database.read_bytes(), journal.read_bytes())
    names = {"bag.db3", "bag.db3-journal", "bag.mcap", "metadata.yaml"}
    assert {path.name.removesuffix(".damaged") for path in bag.iterdir()} == names
