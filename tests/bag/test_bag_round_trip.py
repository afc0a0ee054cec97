"""Bags read back by this package and by the ones that people use."""

from __future__ import annotations

import struct
from collections import Counter
from pathlib import Path

import numpy as np
import pytest
import yaml
from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory
from ride_bag import (
    COMMAND,
    EPISODE,
    LATCHED,
    PERIOD_NS,
    START_NS,
    STATE,
    make_bag,
    ride,
    schemas,
    serialise,
)
from rosbags.highlevel import AnyReader

from bicycle_bag import columns, messages, metadata, repair
from bicycle_bag.errors import BagError
from bicycle_bag.metadata import NO_START, Topic
from bicycle_bag.qos import INFINITE_NS, QosProfile
from bicycle_bag.reader import BagReader
from bicycle_bag.schemas import dependencies, fields
from bicycle_bag.writer import BagWriter


def test_messages_come_back_in_order(tmp_path: Path) -> None:
    written = make_bag(tmp_path / "bag", 100)
    reader = BagReader(tmp_path / "bag")
    got = list(reader.messages())
    assert [(m.topic, m.data, m.log_time_ns) for m in got] == ride(100)
    assert all(m.publish_time_ns == m.log_time_ns - 1000 for m in got)
    assert reader.counts == {STATE: 100, COMMAND: 100, EPISODE: 1}
    assert reader.message_count == written.message_count == 201
    assert reader.starting_time_ns == START_NS - 1000
    assert reader.duration_ns == 99 * PERIOD_NS + 900_000 + 1000
    assert reader.topics[EPISODE].qos == (LATCHED,)
    assert reader.metadata.custom_data == {"seed": "7"}
    assert [m.topic for m in reader.messages([STATE])] == [STATE] * 100


def test_one_file_reads_as_the_directory_does(tmp_path: Path) -> None:
    make_bag(tmp_path / "bag", 10)
    single = BagReader(tmp_path / "bag" / "bag_0.mcap")
    assert list(single.messages()) == list(BagReader(tmp_path / "bag").messages())


def test_the_folder_of_a_ride_is_read_and_repaired_as_its_bag(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    make_bag(tmp_path / "ride" / "bag", 10)
    reader = BagReader(tmp_path / "ride")
    assert reader.path == tmp_path / "ride" / "bag"
    assert reader.counts[STATE] == 10
    assert repair.main([str(tmp_path / "ride")]) == 0
    assert "ride/bag: " in capsys.readouterr().out


@pytest.mark.parametrize("compression", ["zstd", "lz4", "none"])
def test_rosbags_and_mcap_ros2_read_the_same(tmp_path: Path, compression: str) -> None:
    make_bag(tmp_path / "bag", 200, compression=compression)
    with AnyReader([tmp_path / "bag"]) as reader:
        by_rosbags = Counter(connection.topic for connection, _, _ in reader.messages())
        first = next(iter(reader.messages([c for c in reader.connections if c.topic == STATE])))
        state = reader.deserialize(first[2], first[0].msgtype)
        assert reader.duration == BagReader(tmp_path / "bag").duration_ns + 1
    assert state.header.frame_id == "odom"  # type: ignore[attr-defined]
    with (tmp_path / "bag" / "bag_0.mcap").open("rb") as stream:
        decoded = make_reader(stream, decoder_factories=[DecoderFactory()])
        by_mcap = Counter(item.channel.topic for item in decoded.iter_decoded_messages())
        assert decoded.get_header().profile == "ros2"
        assert [record.name for record in decoded.iter_metadata()] == ["rosbag2", "rosbag2"]
    assert by_rosbags == by_mcap == BagReader(tmp_path / "bag").counts


def test_split_by_size_and_by_time(tmp_path: Path) -> None:
    by_time = make_bag(tmp_path / "time", 100, split_seconds=1.0)
    by_size = make_bag(tmp_path / "size", 100, split_bytes=6000, chunk_bytes=1024)
    assert [file.path for file in by_time.files] == ["time_0.mcap", "time_1.mcap", "time_2.mcap"]
    assert len(by_size.files) > 2
    for name in ("time", "size"):
        reader = BagReader(tmp_path / name)
        assert [(m.topic, m.data, m.log_time_ns) for m in reader.messages()] == ride(100)
        assert reader.metadata.files == metadata.read(tmp_path / name).files
        with AnyReader([tmp_path / name]) as foreign:
            assert foreign.message_count == 201


def test_metadata_has_rosbag2s_keys_in_order(tmp_path: Path) -> None:
    written = make_bag(tmp_path / "bag", 4)
    content = yaml.safe_load((tmp_path / "bag" / "metadata.yaml").read_text())
    bag = content["rosbag2_bagfile_information"]
    assert list(bag) == [
        "version",
        "storage_identifier",
        "duration",
        "starting_time",
        "message_count",
        "topics_with_message_count",
        "compression_format",
        "compression_mode",
        "relative_file_paths",
        "files",
        "custom_data",
        "ros_distro",
    ]
    assert bag["version"] == 9
    offer = bag["topics_with_message_count"][0]["topic_metadata"]["offered_qos_profiles"][0]
    assert offer["deadline"] == {"sec": 9223372036, "nsec": 854775807}
    assert offer["history"] == "unknown"
    assert metadata.read(tmp_path / "bag") == written


def test_metadata_before_version_9_is_read(tmp_path: Path) -> None:
    make_bag(tmp_path / "bag", 4)
    path = tmp_path / "bag" / "metadata.yaml"
    content = yaml.safe_load(path.read_text())
    bag = content["rosbag2_bagfile_information"]
    bag["version"] = 4
    for key in ("files", "custom_data", "ros_distro"):
        del bag[key]
    for entry in bag["topics_with_message_count"]:
        topic = entry["topic_metadata"]
        del topic["type_description_hash"]
        offer = topic["offered_qos_profiles"][0]
        offer.update(history=3, reliability=1, durability=2, liveliness=1)
        topic["offered_qos_profiles"] = yaml.safe_dump([offer])
    path.write_text(yaml.safe_dump(content))
    old = metadata.read(tmp_path / "bag")
    assert old.topics[0].qos == (QosProfile(),)
    assert BagReader(tmp_path / "bag").message_count == 9


def test_empty_bag(tmp_path: Path) -> None:
    BagWriter(tmp_path / "bag").close()
    reader = BagReader(tmp_path / "bag")
    assert (reader.message_count, reader.duration_ns) == (0, 0)
    stored = yaml.safe_load((tmp_path / "bag" / "metadata.yaml").read_text())
    bag = stored["rosbag2_bagfile_information"]
    assert bag["starting_time"]["nanoseconds_since_epoch"] == NO_START == INFINITE_NS
    assert bag["custom_data"] is None


def test_columns_equal_decoded_messages(tmp_path: Path) -> None:
    make_bag(tmp_path / "bag", 100)
    table = columns.load_topics(tmp_path / "bag", [STATE, COMMAND, EPISODE])
    for topic, kind in ((STATE, "lean_angle"), (COMMAND, "torque")):
        decoded = list(messages.read(tmp_path / "bag", [topic]))
        loaded = table[topic]
        assert loaded[kind].dtype == np.float64
        np.testing.assert_array_equal(loaded[kind], [getattr(m.message, kind) for m in decoded])
        np.testing.assert_array_equal(loaded["step"], [m.message.step for m in decoded])
        np.testing.assert_allclose(loaded["log_time"], [m.log_time_ns / 1e9 for m in decoded])
        np.testing.assert_allclose(loaded["header.stamp"], np.arange(100) * 0.025)
    decoded = list(messages.read(tmp_path / "bag", [COMMAND]))
    np.testing.assert_array_equal(table[COMMAND]["goal.x"], np.arange(100.0))
    for field in ("controller", "policy", "has_goal"):
        assert list(table[COMMAND][field]) == [getattr(m.message, field) for m in decoded]
    assert np.isnan(table[STATE]["yaw_rate"]).all()
    assert table[EPISODE]["pace"][0] == "lockstep"


def test_columns_of_arrays_and_of_no_messages(tmp_path: Path) -> None:
    kind = "bicycle_msgs/msg/Transition"
    with BagWriter(tmp_path / "bag") as writer:
        for topic in ("/transition", "/silent"):
            writer.add_topic(Topic(topic, kind), schemas().definition(kind))
        for step in range(5):
            values = {"observation": np.arange(6.0) + step, "action": [1.0, 2.0, 3.0]}
            data = serialise("Transition", {**values, "fallen": step == 4, "policy": "p" * step})
            writer.write("/transition", data, step, step)
    table = columns.load(tmp_path / "bag", "/transition")
    np.testing.assert_array_equal(
        table["observation"], np.arange(6.0) + np.arange(5.0)[:, np.newaxis]
    )
    assert list(table["fallen"]) == [False] * 4 + [True]
    silent = columns.load(tmp_path / "bag", "/silent")
    assert silent["observation"].shape == (0, 6)
    assert silent["reward"].shape == silent["log_time"].shape == (0,)


def test_sequences_of_numbers_become_columns(tmp_path: Path) -> None:
    with BagWriter(tmp_path / "bag") as writer:
        writer.add_topic(Topic("/list", "x/msg/List"), "uint8 a\nfloat64[] values\nuint8 b\n")
        for length in (2, 0, 3):
            data = b"\0\1\0\0" + struct.pack("<BxxxI", 7, length)
            data += struct.pack(f"<{length}dB", *range(length), 9)
            writer.write("/list", data, 0, 0)
    table = columns.load(tmp_path / "bag", "/list")
    assert [list(row) for row in table["values"]] == [[0.0, 1.0], [], [0.0, 1.0, 2.0]]
    assert list(table["a"]) == [7, 7, 7]
    assert list(table["b"]) == [9, 9, 9]


def test_columns_refuse_short_messages_and_nested_sequences(tmp_path: Path) -> None:
    with BagWriter(tmp_path / "bag") as writer:
        writer.add_topic(Topic("/short", "x/msg/Short"), "float64 a\nfloat64 b\n")
        writer.add_topic(Topic("/nested", "x/msg/Nested"), "x/Short[] parts\n")
        writer.write("/short", b"\0\1\0\0" + struct.pack("<d", 1.0), 0, 0)
    with pytest.raises(BagError, match="ends before b"):
        columns.load(tmp_path / "bag", "/short")
    with pytest.raises(BagError, match=r"bicycle_bag\.messages"):
        columns.load(tmp_path / "bag", "/nested")
    with pytest.raises(BagError, match="has no topic /other: it has /nested, /short"):
        columns.load(tmp_path / "bag", "/other")
    with pytest.raises(BagError, match=r"is not a x/msg/Short"):
        list(messages.read(tmp_path / "bag", ["/short"]))


def test_definition_lists_each_dependency_once_in_rosbag2s_order() -> None:
    text = schemas().definition("bicycle_msgs/msg/BicycleState")
    parts = [part.splitlines()[0] for part in text.split("=" * 80 + "\n")[1:]]
    assert parts == [
        "MSG: geometry_msgs/Point",
        "MSG: std_msgs/Header",
        "MSG: builtin_interfaces/Time",
    ]


def test_type_hash_is_the_one_of_the_rosbags_store() -> None:
    assert schemas().type_hash("std_msgs/msg/String") == (
        "RIHS01_df668c740482bbd48fb39d76a70dfd4bd59db1288021743503259e948f6b1a18"
    )


def test_definitions_are_parsed_without_constants_and_comments() -> None:
    constants = "uint8 A=1\nuint8 B = 2 # two\n# float64 c\n"
    text = constants + "float64[<=3] d 1.0\nPose e\nstring<=5 f 'a=b'\n"
    assert [tuple(field) for field in fields(text)] == [
        ("float64", "[<=3]", "d"),
        ("Pose", "", "e"),
        ("string", "", "f"),
    ]
    assert dependencies(text, "pkg") == ["pkg/Pose"]


def test_unknown_types_name_the_remedy() -> None:
    with pytest.raises(BagError, match="source the workspace"):
        schemas().definition("nobody_msgs/msg/Nothing")
    with pytest.raises(BagError, match="package/msg/Type"):
        schemas().definition("../msg/Nothing")
