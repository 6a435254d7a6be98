"""Logs in formats with messages and arrays: written by the libraries of these formats, read back
equal; damaged and hostile ones refused."""

import bz2
import importlib.util
import io
import json
import sqlite3
import struct
import zipfile
import zlib
from collections import deque
from functools import cache
from pathlib import Path

import h5py
import log_files as files
import lz4.frame
import numpy as np
import pytest
import scipy.io
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from mcap.writer import CompressionType, IndexType
from nptdms import ChannelObject, GroupObject, RootObject, TdmsWriter
from rosbags.interfaces import Nodetype
from rosbags.rosbag1 import Writer as Bag1
from rosbags.rosbag2 import StoragePlugin
from time_limits import bounded

from steelyard.errors import InputError
from steelyard.logs.arrays import hdf5
from steelyard.logs.formats import format_of, open_log, topics
from steelyard.logs.log import RowRange
from steelyard.logs.messages import blocks, mcap, ros1_bag, ros2_bag
from steelyard.logs.messages.idl import types_in_idl
from steelyard.logs.messages.recording import FileSection, Interval, Message, in_time_order
from steelyard.logs.messages.ros_message import cdr_decoder, ros1_decoder
from steelyard.logs.messages.ros_types import types_of

LONGEST = 10  # [s] that a hostile file may make us compute

MESSAGES = {
    "t": "header.stamp",
    **{f"f{j + 1}": f"effort[{j}]" for j in range(files.CABLES)},
    **{f"w{axis}": f"angular_velocity.{axis}" for axis in "xyz"},
    **{f"a{axis}": f"linear_acceleration.{axis}" for axis in "xyz"},
    **{f"q{axis}": f"orientation.{axis}" for axis in "wxyz"},
    **{axis: f"point.{axis}" for axis in "xyz"},
}
"""Columns of the contract -> fields of messages."""


def read(path, topic=None, names=None, part=None, rows=None):
    """Names of the columns, and some of them or all."""
    with open_log(Path(path), topic) as log:
        return log.names, log.read(log.names if names is None else names, part, rows)


def refused(path, topic=None):
    """The sentence with which a file is refused, wherever in reading it that is."""
    with pytest.raises(InputError) as caught:
        read(path, topic)
    sentence = str(caught.value)
    assert str(path) in sentence
    assert "\n" not in sentence
    return sentence


@pytest.fixture(scope="module")
def found():
    return files.streams()


@pytest.fixture(scope="module")
def small(tmp_path_factory):
    return files.small(tmp_path_factory.mktemp("small"))


# What is written is read


WRITERS = {
    "json.mcap": files.write_mcap_json,
    "json-lz4.mcap": lambda path, found: files.write_mcap_json(
        path, found, compression=CompressionType.LZ4
    ),
    "json-plain.mcap": lambda path, found: files.write_mcap_json(
        path, found, compression=CompressionType.NONE
    ),
    "json-no-chunks.mcap": lambda path, found: files.write_mcap_json(
        path, found, use_chunking=False
    ),
    "json-bare.mcap": lambda path, found: files.write_mcap_json(
        path,
        found,
        repeat_channels=False,
        repeat_schemas=False,
        use_statistics=False,
        use_summary_offsets=False,
    ),
    "ros2.mcap": files.write_mcap_ros2,
    "ros1.mcap": files.write_mcap_ros1,
    "ros1.bag": files.write_bag,
    "ros1-bz2.bag": lambda path, found: files.write_bag(path, found, Bag1.CompressionFormat.BZ2),
    "ros1-lz4.bag": lambda path, found: files.write_bag(path, found, Bag1.CompressionFormat.LZ4),
    "ros2-folder": files.write_bag2,
    "ros2-folder-mcap": lambda path, found: files.write_bag2(path, found, StoragePlugin.MCAP),
    "old.db3": files.write_old_database,
    "a.h5": files.write_hdf5,
    "v5.mat": files.write_mat,
    "v5-packed.mat": lambda path, found: files.write_mat(path, found, do_compression=True),
    "v73.mat": files.write_mat73,
    "a.tdms": files.write_tdms,
}


@pytest.mark.parametrize("name", WRITERS)
@pytest.mark.integration
def test_reads_back_what_was_written(tmp_path, found, name):
    path = tmp_path / name
    WRITERS[name](path, found)
    for topic, table in found.items():
        names = files.ARRAY_COLUMNS[topic] if path.suffix in {".h5", ".mat"} else {}
        names = MESSAGES if path.suffix in {".mcap", ".bag", ".db3", ""} else names
        columns = {column: names.get(column, column) for column in table}
        there, values = read(path, topic, list(columns.values()))
        assert len(set(there)) == len(there)
        for column, in_log in columns.items():
            np.testing.assert_array_equal(
                values[in_log], table[column], err_msg=f"{topic}: {in_log}"
            )


@pytest.mark.parametrize("packed", [True, False])
def test_reads_back_archives_of_arrays(tmp_path, found, packed):
    for name, table in found.items():
        files.write_npz(tmp_path / f"{name}.npz", table, name, compressed=packed)
        _, values = read(tmp_path / f"{name}.npz")
        for column in table:
            np.testing.assert_array_equal(
                values[files.ARRAY_COLUMNS[name].get(column, column)], table[column]
            )


@pytest.mark.parametrize(
    "name", ["ros2.mcap", "ros1.bag", "old.db3", "a.h5", "v5.mat", "v73.mat", "a.tdms"]
)
def test_part_of_the_rows(small, found, name):
    path, topic = small[name]
    t = found["imu"]["t"]
    start, end = t[7], t[29]
    time_name, name = {
        ".mcap": ("header.stamp", "angular_velocity.y"),
        ".bag": ("header.stamp", "angular_velocity.y"),
        ".db3": ("header.stamp", "angular_velocity.y"),
        ".tdms": ("t", "wy"),
    }.get(path.suffix, ("t", "gyro[1]"))
    part = RowRange(time_name, start, end)
    with open_log(path, topic) as log:
        np.testing.assert_array_equal(log.read([name], part)[name], found["imu"]["wy"][7:30])
        np.testing.assert_array_equal(log.read([name, time_name], part, rows=3)[time_name], t[7:10])
        np.testing.assert_array_equal(log.read([name], rows=2)[name], found["imu"]["wy"][:2])
        with pytest.raises(InputError, match=r"found none; correct the window"):
            log.read([name], RowRange(time_name, 1e6, 2e6))


def test_rows_of_unsorted_time(tmp_path):
    t = np.array([3.0, 1.0, np.nan, 2.0, 5.0])
    np.savez(tmp_path / "a.npz", t=t, x=np.arange(5.0))
    _, values = read(tmp_path / "a.npz", None, ["x"], RowRange("t", 1.5, 3.5))
    np.testing.assert_array_equal(values["x"], [0, 3])


# Topics


@pytest.mark.parametrize("name", ["json.mcap", "ros2.mcap", "ros1.bag", "old.db3"])
def test_topic_with_and_without_slash(small, name):
    path, _ = small[name]
    with open_log(path, "/imu") as one, open_log(path, "imu") as other:
        assert one.names == other.names


@pytest.mark.slow
@pytest.mark.integration
@pytest.mark.parametrize("name", ["json.mcap", "ros2.mcap", "ros1.bag", "old.db3"])
def test_several_topics(small, name):
    path, _ = small[name]
    kind = "Imu" if name == "json.mcap" else "sensor_msgs/msg/Imu"
    assert "expected 'topic' to say which of its topics to read, found /cables" in refused(path)
    assert f"/imu ({kind}), /tracker" in refused(path)
    assert "expected a topic '/gyro', found /cables" in refused(path, "/gyro")


@pytest.mark.slow
@pytest.mark.integration
@pytest.mark.parametrize(
    ("name", "what"), [("a.h5", "group"), ("v5.mat", "structure"), ("v73.mat", "structure")]
)
def test_several_groups(small, name, what):
    path, _ = small[name]
    assert f"which of its {what}s to read, found cables, imu, tracker; name one" in refused(path)
    assert f"expected a {what} 'gyro', found cables, imu, tracker" in refused(path, "gyro")


def test_at_most_twenty_are_named(tmp_path):
    with h5py.File(tmp_path / "a.h5", "w") as file:
        for i in range(40):
            file[f"g{i:02}/x"] = np.arange(3.0)
    assert refused(tmp_path / "a.h5").endswith("g18, g19, …; name one")


def test_only_topic_with_numbers(tmp_path):
    messages = []
    for i in range(5):
        ns = (i + 1) * 10**9
        messages += [("/note", ns, b'{"text": "x"}'), ("/force", ns, json.dumps({"f": i}).encode())]
        messages += [("/rosout", ns, b'{"level": 3, "line": 12}'), ("/tick", ns, b'{"empty": {}}')]
    channels = dict.fromkeys(("/note", "/force", "/rosout", "/tick"), ("json", None))
    files.write_mcap(tmp_path / "a.mcap", channels, messages)
    names, values = read(tmp_path / "a.mcap")
    assert names == ("receive_time", "publish_time", "f")
    np.testing.assert_array_equal(values["receive_time"], [1, 2, 3, 4, 5])
    np.testing.assert_allclose(
        values["publish_time"] - values["receive_time"], -files.DELAY * 1e-9, atol=1e-15
    )
    files.write_mcap(tmp_path / "b.mcap", {"/note": ("json", None)}, messages[:1])
    assert "expected messages with numbers, found topics /note (json)" in refused(
        tmp_path / "b.mcap"
    )


def test_receive_time_and_stamp(small, found):
    _, values = read(*small["ros2.mcap"])
    np.testing.assert_allclose(
        values["receive_time"] - values["header.stamp"], files.DELAY * 1e-9, atol=1e-12
    )
    np.testing.assert_array_equal(values["publish_time"], values["header.stamp"])


def test_rows_in_the_order_in_which_they_were_received(tmp_path):
    times = np.random.default_rng(0).permutation(300) + 1
    messages = [("/a", int(ns) * 10**7, json.dumps({"i": int(ns)}).encode()) for ns in times]
    for options in ({"chunk_size": 256}, {"use_chunking": False}):
        files.write_mcap(tmp_path / "a.mcap", {"/a": ("json", None)}, messages, **options)
        np.testing.assert_array_equal(
            read(tmp_path / "a.mcap", None, ["i"])[1]["i"], np.arange(300) + 1
        )


def test_pieces_that_do_not_overlap_are_read_one_by_one():
    reading = []

    def piece(start):
        def read():
            reading.append(start)
            return [Message(start + i, None, 0, b"") for i in range(10)]

        return FileSection(Interval(start, start + 9), read)

    messages = in_time_order(piece(start) for start in (20, 0, 10))
    assert next(messages).received == 0
    assert reading == [0]
    assert [message.received for message in messages] == list(range(1, 30))


@pytest.mark.parametrize(
    ("name", "expected"),
    [
        *((name, ["/cables", "/imu", "/tracker"]) for name in ("json.mcap", "ros2.mcap")),
        *((name, ["/cables", "/imu", "/tracker"]) for name in ("ros1.bag", "old.db3")),
        *((name, ["cables", "imu", "tracker"]) for name in ("a.h5", "v5.mat", "v73.mat")),
        *((name, []) for name in ("a.tdms", "imu.npz")),
    ],
)
@pytest.mark.integration
def test_topics_of_every_format(small, name, expected):
    path, _ = small[name]
    assert topics(path) == expected
    for topic in expected:
        assert read(path, topic)[0]


def test_a_table_has_no_topics(tmp_path, found):
    files.write_csv(tmp_path / "a.csv", found["imu"])
    files.write_parquet(tmp_path / "a.parquet", found["imu"])
    assert topics(tmp_path / "a.csv") == topics(tmp_path / "a.parquet") == []


def test_only_group_needs_no_topic(tmp_path):
    with h5py.File(tmp_path / "a.h5", "w") as file:
        file["day/run/x"] = np.arange(3.0)
        file["day/run/more/y"] = np.arange(3.0)
    assert topics(tmp_path / "a.h5") == []
    with h5py.File(tmp_path / "b.h5", "w") as file:
        for name in ("one, two", "three"):
            file[f"day/{name}/x"] = np.arange(3.0)
    assert topics(tmp_path / "b.h5") == ["day.one, two", "day.three"]


# Windows


SECONDS, HERTZ = 300, 20
"""Of a recording that is long beside its windows."""


def long_streams(stamps):
    """A tracker of some minutes whose stamps are these functions of time."""
    t = np.arange(SECONDS * HERTZ) / HERTZ + 1
    rng = np.random.default_rng(8)
    stamped = np.round(stamps(t), 6)
    return {"tracker": {"t": stamped, **{axis: rng.normal(size=len(t)) for axis in "xyz"}}}


LONG = {
    "json.mcap": files.write_mcap_json,
    "plain.mcap": lambda path, found: files.write_mcap_json(path, found, use_chunking=False),
    "ros2.mcap": files.write_mcap_ros2,
    "ros1.bag": lambda path, found: files.write_bag(path, found, chunk_size=4096),
    "ros2-folder": files.write_bag2,
    "old.db3": files.write_old_database,
}
"""Formats of messages."""


@pytest.fixture
def decoded(monkeypatch):
    """How many messages were decoded."""
    count = []

    def counting(decoder):
        def decode(data):
            count.append(len(data))
            return decoder(data)

        return decode

    for module in (mcap, ros1_bag, ros2_bag):
        contents = {mcap: "_Contents", ros1_bag: "_Bag", ros2_bag: "_Database"}[module]
        decoder_of = getattr(module, contents).decoder
        monkeypatch.setattr(
            getattr(module, contents),
            "decoder",
            lambda self, channel, decoder_of=decoder_of: counting(decoder_of(self, channel)),
        )
    return count


@pytest.mark.slow
@pytest.mark.parametrize("name", LONG)
@pytest.mark.parametrize("column", ["header.stamp", "receive_time"])
@pytest.mark.integration
def test_a_window_does_not_decode_every_message(tmp_path, decoded, name, column):
    found = long_streams(lambda t: t)
    LONG[name](tmp_path / name, found)
    t, x = found["tracker"]["t"], found["tracker"]["x"]
    for start in (1.0, 120.0, SECONDS - 0.5):
        received = start + (files.DELAY * 1e-9 if column == "receive_time" else 0)
        part = RowRange(column, received - 1e-6, received + 1 + 1e-6)
        with format_of(tmp_path / name).opened(tmp_path / name, "tracker") as log:
            decoded.clear()
            values = log.read(["point.x"], part)["point.x"]
        inside = (t >= start - 1e-6) & (t <= start + 1 + 1e-6)
        np.testing.assert_array_equal(values, x[inside])
        # The window, two seconds on either side, and single messages of the bisection.
        assert len(values) <= len(decoded) <= len(values) + 4 * HERTZ + 50


@pytest.mark.parametrize(
    "stamps",
    [
        lambda t: t + 1.7e9,
        lambda t: t**2 / SECONDS,
        lambda t: np.round(t),
        lambda t: np.where(t < 100, t, t + 1e9),
        lambda t: t + 0.03 * (np.arange(len(t)) % 2),
        lambda t: np.maximum(t, 200.0),
    ],
    ids=["epoch", "uneven", "coarse", "jump", "overtaken", "late"],
)
@pytest.mark.integration
def test_a_window_of_any_stamps_is_the_part_of_all(tmp_path, stamps):
    """Clocks of their own, uneven ones, and messages that overtake each other a little."""
    found = long_streams(stamps)
    files.write_mcap_json(tmp_path / "a.mcap", found, times=np.arange(SECONDS * HERTZ) / HERTZ)
    t, x = found["tracker"]["t"], found["tracker"]["x"]
    for first, last in ((0, 30), (2500, 2520), (len(t) - 1, len(t) - 1)):
        start, end = sorted((t[first], t[last]))
        _, values = read(
            tmp_path / "a.mcap", None, ["point.x"], RowRange("header.stamp", start, end)
        )
        np.testing.assert_array_equal(values["point.x"], x[(t >= start) & (t <= end)])


@pytest.mark.integration
def test_a_clock_that_was_set_back_is_read_as_a_whole(tmp_path):
    """Times decrease somewhere: then nothing is skipped."""
    found = long_streams(lambda t: np.where(t < 150, t + 1000, t))
    files.write_mcap_json(tmp_path / "a.mcap", found, times=np.arange(SECONDS * HERTZ) / HERTZ)
    t, x = found["tracker"]["t"], found["tracker"]["x"]
    for start in (1010.0, 200.0):
        part = RowRange("header.stamp", start, start + 5)
        _, values = read(tmp_path / "a.mcap", None, ["point.x"], part)
        np.testing.assert_array_equal(values["point.x"], x[(t >= start) & (t <= start + 5)])


def test_the_search_of_a_window_is_no_more_than_some_readings_of_everything(tmp_path, monkeypatch):
    """Without an index, a topic that ended early would be looked for in all that follows, again and
    again."""
    messages = [("/a", (i + 1) * 10**8, b'{"x": 1}') for i in range(6000)]
    messages += [("/b", (i + 1) * 10**8 + 1, b'{"t": %d}' % i) for i in range(300)]
    channels = {"/a": ("json", None), "/b": ("json", None)}
    files.write_mcap(tmp_path / "a.mcap", channels, messages, index_types=IndexType.NONE)
    sizes = []
    unpack = blocks.unpacked

    def counted(data, method, size):
        sizes.append(size)
        return unpack(data, method, size)

    monkeypatch.setattr(blocks, "unpacked", counted)
    with format_of(tmp_path / "a.mcap").opened(tmp_path / "a.mcap", "/b") as log:
        sizes.clear()
        log.read(["t"])
        everything = sum(sizes)
        sizes.clear()
        assert len(log.read(["t"], RowRange("t", 100, 120))["t"]) == 21
    assert sum(sizes) <= 6 * everything


def test_chunks_outside_a_window_are_not_unpacked(tmp_path, monkeypatch):
    files.write_mcap_ros2(tmp_path / "a.mcap", long_streams(lambda t: t), chunk_size=1024)
    sizes = []
    unpack = blocks.unpacked

    def counted(data, method, size):
        sizes.append(size)
        return unpack(data, method, size)

    with format_of(tmp_path / "a.mcap").opened(tmp_path / "a.mcap", None) as log:
        everything = len(log.read(["point.x"])["point.x"])
        monkeypatch.setattr(blocks, "unpacked", counted)
        log.read(["point.x"])
        chunks = len(sizes)
        sizes.clear()
        log.read(["point.x"], RowRange("header.stamp", 120, 121))
    assert everything == SECONDS * HERTZ
    assert chunks > 400
    assert len(sizes) < chunks / 5


# Messages of ROS


def random_message(store, name, rng):
    """A message of a type of rosbags, with lists of any length."""
    if name.startswith("builtin_interfaces/"):
        return store.types[name](
            sec=int(rng.integers(0, 2**31)), nanosec=int(rng.integers(0, 10**9))
        )
    return store.types[name](
        **{field: random_value(store, kind, rng) for field, kind in store.fielddefs[name][1]}
    )


def random_value(store, kind, rng):
    node, detail = kind
    if node == Nodetype.NAME:
        return random_message(store, detail, rng)
    if node == Nodetype.BASE:
        return random_scalar(detail[0], rng)
    inner, size = detail
    number = size if node == Nodetype.ARRAY else int(rng.integers(0, 4))
    items = [random_value(store, inner, rng) for _ in range(number)]
    return np.array(items, dtype=dtype_of(inner[1][0])) if is_number(inner) else items


def random_scalar(name, rng):
    if name == "string":
        return "x" * int(rng.integers(0, 7))
    if name == "bool":
        return bool(rng.integers(2))
    if name.startswith("float"):
        return float(np.dtype(name).type(rng.normal()))
    info = np.iinfo(dtype_of(name))
    return int(rng.integers(info.min, info.max, dtype=info.dtype, endpoint=True))


def is_number(kind):
    return kind[0] == Nodetype.BASE and kind[1][0] != "string"


def dtype_of(name):
    return {"bool": np.bool_, "byte": np.int8, "char": np.uint8, "octet": np.uint8}.get(name, name)


def numbers_of(store, message, name, label):
    """Numbers of a message object of rosbags, by name."""
    if name in {"builtin_interfaces/msg/Time", "builtin_interfaces/msg/Duration"} and label:
        return {label: (message.sec * 10**9 + message.nanosec) / 10**9}
    values = {}
    for field, (node, detail) in store.fielddefs[name][1]:
        value, own = getattr(message, field), f"{label}.{field}" if label else field
        if field == "structure_needs_at_least_one_member" or (
            node == Nodetype.BASE and detail[0] == "string"
        ):
            continue
        if node == Nodetype.NAME:
            values |= numbers_of(store, value, detail, own)
        elif node == Nodetype.BASE:
            values[own] = value
        elif detail[0][0] == Nodetype.NAME:
            for i, part in enumerate(value):
                values |= numbers_of(store, part, detail[0][1], f"{own}[{i}]")
        elif is_number(detail[0]):
            values |= {f"{own}[{i}]": part for i, part in enumerate(value)}
    return values


@pytest.mark.integration
@pytest.mark.parametrize("ros1", [False, True])
def test_decoder_agrees_with_rosbags_on_every_common_type(ros1):
    rng = np.random.default_rng(11)
    store = files.store(ros1)
    for name in store.fielddefs:
        types = types_of(Path("x"), name, "msg", files.definition(name, ros1), ros1=ros1)
        message = random_message(store, name, rng)
        want = numbers_of(store, message, name, "")
        if ros1:
            written = {ros1_decoder: [store.serialize_ros1(message, name)]}
        else:
            orders = (True, False)
            written = {
                cdr_decoder: [
                    store.serialize_cdr(message, name, little_endian=order) for order in orders
                ]
            }
        for decoder, contents in written.items():
            for content in contents:
                assert decoder(types, name)(bytes(content)) == want, name


def ros_topic(path, kind, messages, **options):
    """One topic of messages of ROS 2 in an MCAP file."""
    data = [bytes(files.store().serialize_cdr(message, kind)) for message in messages]
    channels = {"/a": ("cdr", (kind, "ros2msg", files.definition(kind)))}
    files.write_mcap(
        path, channels, [("/a", (i + 1) * 10**9, each) for i, each in enumerate(data)], **options
    )


def kinds(*names):
    return [files.store().types[name] for name in names]


def test_stamped_messages(tmp_path):
    point, quaternion, vector, pose, transform, wrench = kinds(
        *(
            f"geometry_msgs/msg/{kind}"
            for kind in ("Point", "Quaternion", "Vector3", "Pose", "Transform", "Wrench")
        )
    )
    head = files.header(files.store(), 5_250_000_000, "world", False)
    parts = {
        "PoseStamped": pose(point(1.0, 2.0, 3.0), quaternion(0.1, 0.2, 0.3, 0.9)),
        "TransformStamped": transform(vector(1.0, 2.0, 3.0), quaternion(0.1, 0.2, 0.3, 0.9)),
        "WrenchStamped": wrench(vector(1.0, 2.0, 3.0), vector(4.0, 5.0, 6.0)),
    }
    expected = {
        "PoseStamped": {"pose.position.z": 3, "pose.orientation.w": 0.9},
        "TransformStamped": {"transform.translation.y": 2, "transform.rotation.x": 0.1},
        "WrenchStamped": {"wrench.force.x": 1, "wrench.torque.z": 6},
    }
    for kind, part in parts.items():
        (stamped,) = kinds(f"geometry_msgs/msg/{kind}")
        child = ["child"] if kind == "TransformStamped" else []
        ros_topic(tmp_path / "a.mcap", f"geometry_msgs/msg/{kind}", [stamped(head, *child, part)])
        _, values = read(tmp_path / "a.mcap")
        assert values["header.stamp"] == 5.25
        assert {name: values[name][0] for name in expected[kind]} == expected[kind]


def test_lists_of_other_lengths(tmp_path):
    layout, array, dimension = kinds(
        "std_msgs/msg/MultiArrayLayout",
        "std_msgs/msg/Float64MultiArray",
        "std_msgs/msg/MultiArrayDimension",
    )
    messages = [array(layout([dimension("x", 3, 3)], 0), np.arange(float(n))) for n in (3, 2, 4, 0)]
    ros_topic(tmp_path / "a.mcap", "std_msgs/msg/Float64MultiArray", messages)
    names, values = read(tmp_path / "a.mcap")
    assert set(names) == {
        *(
            "receive_time",
            "publish_time",
            "layout.dim[0].size",
            "layout.dim[0].stride",
            "layout.data_offset",
        ),
        *(f"data[{i}]" for i in range(4)),
    }
    np.testing.assert_array_equal(values["data[2]"], [2, np.nan, 2, np.nan])
    np.testing.assert_array_equal(values["receive_time"], [1, 2, 3, 4])


def test_images_are_no_columns(tmp_path):
    (image,) = kinds("sensor_msgs/msg/Image")
    head = files.header(files.store(), 10**9, "x", False)
    ros_topic(
        tmp_path / "a.mcap",
        "sensor_msgs/msg/Image",
        [image(head, 60, 80, "mono8", 0, 80, np.zeros(4800, np.uint8))],
    )
    assert [name for name in read(tmp_path / "a.mcap")[0] if name.startswith("data")] == []


@pytest.mark.parametrize("quantity", ["orientation", "angular_velocity", "linear_acceleration"])
def test_covariance_of_minus_one_says_that_there_is_none(tmp_path, quantity):
    table = files.streams()["imu"]
    messages = [files.as_ros("imu", table, i, 10**9) for i in range(3)]
    for message in messages:
        getattr(message, f"{quantity}_covariance")[:] = -1.0
    ros_topic(tmp_path / "a.mcap", files.TYPES["imu"], messages)
    names, _ = read(tmp_path / "a.mcap")
    assert not [name for name in names if name.startswith(quantity)]
    # In one message alone it is a lost sample.
    for message in messages[1:]:
        getattr(message, f"{quantity}_covariance")[:] = 0.0
    ros_topic(tmp_path / "b.mcap", files.TYPES["imu"], messages)
    _, values = read(tmp_path / "b.mcap")
    np.testing.assert_array_equal(np.isnan(values[f"{quantity}.x"]), [True, False, False])


IDL = """\
// generated
#include "other.idl"
"""

IDL_TEXT = """\
module my_msgs {
  module msg {
    typedef double double__3[3];
    module Force_Constants {
      const uint8 CABLES = 8;
    };
    @verbatim (language="comment", text=
      "Forces (N) of << the cables")
    struct Force {
      @unit (value="N")
      double__3 axis;
      sequence<double> cables;
      string name;
      boolean valid;
    };
  };
};
"""


def test_definitions_in_idl(tmp_path):
    data = b"\x00\x01\x00\x00" + struct.pack("<3dIxxxx2dI3sB", 1, 2, 3, 2, 4, 5, 3, b"ab\0", True)
    channels = {
        "/a": (
            "cdr",
            ("my_msgs/msg/Force", "ros2idl", "=" * 80 + "\nIDL: my_msgs/msg/Force\n" + IDL_TEXT),
        )
    }
    files.write_mcap(tmp_path / "a.mcap", channels, [("/a", 10**9, data)])
    _, values = read(tmp_path / "a.mcap")
    wanted = {"axis[0]": 1, "axis[2]": 3, "cables[0]": 4, "cables[1]": 5, "valid": 1}
    assert {name: values[name][0] for name in wanted} == wanted


IDL_TYPES = [
    *("boolean", "octet", "char", "wchar", "string", "wstring", "float", "double", "long double"),
    *("short", "long", "long long", "unsigned short", "unsigned long", "unsigned  long long"),
    *(f"{sign}int{bits}" for sign in ("", "u") for bits in (8, 16, 32, 64)),
]


def test_idl_agrees_with_rosbags():
    from rosbags.typesys import get_types_from_idl

    plain = "".join(f"{kind} f{i};" for i, kind in enumerate(IDL_TYPES))
    many = "".join(f"sequence<{kind}> g{i}, h{i};" for i, kind in enumerate(IDL_TYPES))
    text = f"""
// generated
module my {{ module msg {{
  typedef double double__3[3];  typedef sequence<octet, 4> some;  typedef double__3 again;
  module A_Constants {{ const uint8 N = 0x10; const string T = "a;" "b"; const float X = -1.5; }};
  const long M = 7;  const long L = M;
  enum Kind {{ ONE, TWO }};
  struct B {{ double__3 axis; again twice; some bytes; }};
  @verbatim (language="comment", text= "Forces (N) of << the cables")
  struct A {{ {plain} {many} @unit (value="N") std_msgs::msg::Header header; B b; my::msg::B c;
    B d[4], e; string<12> s; sequence<string<5> > t; sequence<B, 3> u; ::other::msg::C v;
    double w[M]; /* a [ */ double z[L]; }};
}}; }};"""
    theirs = {name: fields for name, (_, fields) in get_types_from_idl(text).items()}
    ours = types_in_idl(text)
    assert ours.keys() == theirs.keys()
    for name, fields in ours.items():
        # They keep the stroke of a name from the top, which no type has.
        want = [
            (field, (2, "other/msg/C") if description == (2, "/other/msg/C") else description)
            for field, description in theirs[name]
        ]
        assert fields == want


def test_parts_of_a_bag(tmp_path, found):
    """A bag in several files, as recorders split them."""
    first = {
        name: {column: values[:20] for column, values in table.items()}
        for name, table in found.items()
    }
    second = {
        name: {column: values[20:] for column, values in table.items()}
        for name, table in found.items()
    }
    files.write_bag2(tmp_path / "one", first)
    files.write_bag2(tmp_path / "two", second)
    (tmp_path / "two" / "two.db3").rename(tmp_path / "one" / "two.db3")
    metadata = tmp_path / "one" / "metadata.yaml"
    metadata.write_text(
        metadata.read_text().replace("  - one.db3\n", "  - one.db3\n  - two.db3\n", 1)
    )
    assert metadata.read_text().count("two.db3") == 1
    _, values = read(tmp_path / "one", "tracker")
    np.testing.assert_array_equal(values["point.x"], found["tracker"]["x"])
    np.testing.assert_array_equal(values["header.stamp"], found["tracker"]["t"])


# Messages in JSON


def json_topic(path, texts, **options):
    messages = [
        ("/a", (i + 1) * 10**9, text.encode() if isinstance(text, str) else text)
        for i, text in enumerate(texts)
    ]
    files.write_mcap(path, {"/a": ("json", None)}, messages, **options)
    return path


def test_numbers_in_json(tmp_path):
    texts = [
        (
            '{"a": {"b": [1, [2, 3]]}, "on": true, "none": null, "text": "1", "header": {"stamp":'
            ' {"sec": 12, "nsec": 500000000}}, "x": NaN}'
        ),
        '{"a": {"b": [4]}, "on": false, "time": {"nanosec": 1, "sec": 1700000000}, "x": 1e-400}',
    ]
    names, values = read(json_topic(tmp_path / "a.mcap", texts))
    assert names[2:] == ("a.b[0]", "a.b[1][0]", "a.b[1][1]", "on", "header.stamp", "x", "time")
    np.testing.assert_array_equal(values["a.b[1][1]"], [3, np.nan])
    np.testing.assert_array_equal(values["header.stamp"], [12.5, np.nan])
    np.testing.assert_array_equal(values["on"], [1, 0])
    np.testing.assert_array_equal(values["x"], [np.nan, 0])
    assert values["time"][1] == 1700000000.000000001


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        ('{"a": 1, "a": 2}', "a key twice"),
        ('{"a.b": 1, "a": {"b": 2}}', "the name 'a.b' twice"),
        ("[1, 2]", "no JSON object"),
        ("{", "found something else (Expecting property name"),
        (b"\xff\xfe", "can't decode byte"),
        ('{"a": ' + "[" * 100_000 + "]" * 100_000 + "}", "recursion"),
        ('{"a": ' + "[" * 100 + "1" + "]" * 100 + "}", "more than 50 deep"),
        ('{"a": 1e999}', "column 'a': expected a finite number, found infinity"),
        ('{"a": -Infinity}', "found infinity"),
        ('{"a": 1%s}' % ("0" * 400), "found infinity"),
        ('{"a": 1%s}' % ("0" * 5000), "integer string conversion"),
        ('{"t": {"sec": 1%s, "nsec": 0}}' % ("0" * 400), "found infinity"),
        (json.dumps({f"c{i}": 1 for i in range(100_000)}), "expected at most 10000 columns"),
    ],
)
def test_hostile_json(tmp_path, text, sentence):
    with bounded(LONGEST):
        assert sentence in refused(json_topic(tmp_path / "a.mcap", [text]))


# Arrays


@pytest.mark.integration
def test_trees_of_hdf5(tmp_path):
    with h5py.File(tmp_path / "a.h5", "w") as file:
        group = file.create_group("data/run")
        group["t"] = np.arange(6) * 0.5
        group["t"].attrs["units"] = "s"
        group["force/left"] = np.arange(6, dtype=np.int16)
        group["force/left"].attrs["units"] = "fathoms"
        group["row"] = np.arange(6.0)[None, :]
        group["column"] = np.arange(6.0)[:, None]
        group["rotation"] = np.arange(54.0).reshape(6, 3, 3)
        group["name"] = ["a"] * 6
        group["scalar"] = 3.0
        group["complex"] = np.zeros(6, complex)
        group["image"] = np.zeros((6, 40, 40))
        compound = np.zeros(
            6, dtype=[("x", ">f4"), ("inner", [("v", "f8", (3,)), ("s", "S4")]), ("on", "?")]
        )
        compound["inner"]["v"] = np.arange(18).reshape(6, 3)
        group["compound"] = compound
    names, values = read(tmp_path / "a.h5")
    assert set(names) == {
        *("t", "force.left", "row", "column", "compound.x", "compound.on"),
        *(f"compound.inner.v[{i}]" for i in range(3)),
        *(f"rotation[{i}][{j}]" for i in range(3) for j in range(3)),
    }
    np.testing.assert_array_equal(values["rotation[1][2]"], np.arange(6) * 9 + 5)
    np.testing.assert_array_equal(values["compound.inner.v[2]"], np.arange(6) * 3 + 2)
    np.testing.assert_array_equal(values["row"], np.arange(6))
    with open_log(tmp_path / "a.h5") as log:
        assert log.units == {"t": "s"}
    for topic in ("/data/run", "data/run", "data.run"):
        assert read(tmp_path / "a.h5", topic)[0] == names
    assert read(tmp_path / "a.h5", "data/run/force")[0] == ("left",)
    assert read(tmp_path / "a.h5", "data/run/compound/inner")[0] == ("v[0]", "v[1]", "v[2]")


def test_datasets_of_other_lengths(tmp_path):
    with h5py.File(tmp_path / "a.h5", "w") as file:
        file["t"], file["x"], file["y"] = np.arange(5.0), np.arange(5.0), np.arange(4.0)
    with open_log(tmp_path / "a.h5") as log:
        with pytest.raises(
            InputError, match=r"expected columns of one length, found 't' with 5, 'y' with 4 rows"
        ):
            log.read(["t", "y"])
        assert len(log.read(["t", "x"])["x"]) == 5


@pytest.mark.integration
@pytest.mark.parametrize("version", ["4", "5"])
def test_variables_of_matlab(tmp_path, version):
    variables = {
        "t": np.arange(4.0)[:, None],
        "row": np.arange(4.0)[None, :],
        "a": np.arange(8.0).reshape(4, 2),
    }
    if version == "5":
        variables |= {
            "counts": np.arange(4, dtype=np.uint8)[:, None],
            "on": np.array([[True], [False], [True], [True]]),
            "text": "hello",
            "cell": np.array([[1.0], "x"], dtype=object),
            "deep": {"a": {"b": np.arange(4.0)[:, None]}},
            "many": np.array([(1.0,), (2.0,)], dtype=[("x", object)]),
            "nothing": np.empty((0, 0)),
        }
    scipy.io.savemat(tmp_path / "a.mat", variables, format=version)
    with open_log(tmp_path / "a.mat") as log:
        values = log.read([name for name in log.names if not name.startswith("many")])
        names = set(log.names)
    assert {"t", "row", "a[0]", "a[1]"} <= names
    np.testing.assert_array_equal(values["a[1]"], [1, 3, 5, 7])
    np.testing.assert_array_equal(values["row"], np.arange(4))
    if version == "5":
        assert names == {
            "t",
            "row",
            "a[0]",
            "a[1]",
            "counts",
            "on",
            "deep.a.b",
            "many[0].x",
            "many[1].x",
        }
        np.testing.assert_array_equal(values["deep.a.b"], np.arange(4))
        np.testing.assert_array_equal(values["on"], [1, 0, 1, 1])
        assert read(tmp_path / "a.mat", "deep.a")[0] == ("b",)


def test_variables_of_matlab_7_3(tmp_path):
    path = tmp_path / "a.mat"
    with h5py.File(path, "w", userblock_size=512) as file:

        def add(name, array, kind, **attributes):
            file[name] = array
            for key, value in {"MATLAB_class": np.bytes_(kind), **attributes}.items():
                file[name].attrs[key] = value

        add("t", np.arange(4.0)[None, :], "double")
        add("row", np.arange(4.0)[:, None], "single")
        add("a", np.arange(8.0).reshape(4, 2).T, "double")
        add("on", np.array([[1, 0, 1, 1]], np.uint8), "logical", MATLAB_int_decode=np.int32(1))
        add("text", np.array([[104], [105]], np.uint16), "char")
        add("none", np.zeros(2, np.uint64), "double", MATLAB_empty=np.uint8(1))
        add("log", np.zeros((1, 6), np.uint32), "timeseries", MATLAB_object_decode=np.int32(3))
        file["#refs#/a"] = np.arange(3.0)
        cell = file.create_dataset("cell", (1, 1), dtype=h5py.ref_dtype)
        cell[0, 0] = file["#refs#/a"].ref
        cell.attrs["MATLAB_class"] = np.bytes_("cell")
    files.write_mat73_header(path)
    names, values = read(path)
    assert set(names) == {"t", "row", "a[0]", "a[1]", "on"}
    np.testing.assert_array_equal(values["a[1]"], [1, 3, 5, 7])
    np.testing.assert_array_equal(values["row"], np.arange(4))


@pytest.mark.integration
def test_objects_of_matlab_are_named(tmp_path):
    path = tmp_path / "a.mat"
    with h5py.File(path, "w", userblock_size=512) as file:
        file["log"] = np.zeros((1, 6), np.uint32)
        file["log"].attrs["MATLAB_class"] = np.bytes_("timetable")
    files.write_mat73_header(path)
    assert "found log: timetable; save numbers, such as [x.Time, x.Data]" in refused(path)
    scipy.io.savemat(tmp_path / "b.mat", {"text": "hello"})
    assert "found text: char; save numbers" in refused(tmp_path / "b.mat")


@pytest.mark.integration
def test_waveforms_of_tdms(tmp_path):
    start = np.datetime64("2024-05-06T07:08:09.25", "us")

    def waveform(group, name, n, later, **properties):
        about = {
            "wf_start_time": start + np.timedelta64(later, "us"),
            "wf_increment": 0.25,
            "wf_start_offset": 0.5,
        }
        return ChannelObject(group, name, np.arange(float(n)), properties={**about, **properties})

    with TdmsWriter(tmp_path / "a.tdms") as writer:
        writer.write_segment(
            [
                RootObject({"title": "x"}),
                GroupObject("force"),
                waveform("force", "f1", 5, 0, unit_string="kN"),
                waveform("force", "f2", 5, 0, unit_string="fathom"),
                waveform("imu", "wx", 7, 125_000, NI_UnitDescription="deg/s"),
                waveform("mixed", "a", 3, 0),
                waveform("mixed", "b", 3, 0, wf_increment=0.125),
                ChannelObject("stamps", "time", start + np.arange(4) * np.timedelta64(1500, "ms")),
                ChannelObject("stamps", "text", ["a", "b"]),
            ]
        )
    with open_log(tmp_path / "a.tdms", "force") as log:
        assert log.names == ("f1", "f2", "t")
        assert log.units == {"f1": "kN", "t": "s"}
        np.testing.assert_array_equal(log.read(["t"])["t"], 0.5 + 0.25 * np.arange(5))
    # All channels of a file share one clock.
    np.testing.assert_allclose(
        read(tmp_path / "a.tdms", "imu", ["t"])[1]["t"], 0.625 + 0.25 * np.arange(7), atol=1e-9
    )
    assert set(read(tmp_path / "a.tdms", "mixed")[0]) == {"a", "b", "a.t", "b.t"}
    seconds = start.astype(np.int64) * 1e-6
    np.testing.assert_allclose(
        read(tmp_path / "a.tdms", "stamps")[1]["time"], seconds + 1.5 * np.arange(4), atol=1e-6
    )
    with open_log(tmp_path / "a.tdms") as log:
        assert {"force.f1", "force.t", "imu.wx", "stamps.time"} <= set(log.names)


def test_only_group_of_tdms(tmp_path):
    with TdmsWriter(tmp_path / "a.tdms") as writer:
        writer.write_segment(
            [ChannelObject("log", "a", np.arange(3.0)), ChannelObject("log", "b", np.arange(3))]
        )
        writer.write_segment(
            [ChannelObject("log", "a", np.arange(3.0)), ChannelObject("log", "b", np.arange(3))]
        )
    names, values = read(tmp_path / "a.tdms")
    assert names == ("a", "b")
    np.testing.assert_array_equal(values["b"], [0, 1, 2, 0, 1, 2])


def test_index_beside_is_not_read(tmp_path):
    with TdmsWriter(tmp_path / "a.tdms") as writer:
        writer.write_segment([ChannelObject("log", "a", np.arange(3.0))])
    (tmp_path / "a.tdms_index").write_bytes(b"TDSh" + bytes(100))
    np.testing.assert_array_equal(read(tmp_path / "a.tdms")[1]["a"], [0, 1, 2])


def test_kinds_of_numpy_arrays(tmp_path):
    start = np.datetime64("2024-05-06T07:08:09.5", "ms")
    structured = np.zeros(3, dtype=[("x", "f4"), ("inner", [("v", "i2", (2,))]), ("s", "U3")])
    structured["inner"]["v"] = np.arange(6).reshape(3, 2)
    arrays = {
        "t": start + np.array([0, 250, 500], "m8[ms]"),
        "span": np.array([1, 2, "NaT"], "m8[us]"),
        "fortran": np.asfortranarray(np.arange(6.0).reshape(3, 2)),
        "half": np.arange(3, dtype=np.float16),
        "big": np.arange(3, dtype=">i4"),
        "on": np.array([True, False, True]),
        "row": np.arange(3.0)[None, :],
        "structured": structured,
        "text": np.array(["a", "b", "c"]),
        "complex": np.zeros(3, complex),
        "scalar": np.array(1.0),
        "wide": np.zeros((3, 1001)),
    }
    np.savez(tmp_path / "a.npz", **arrays)
    names, values = read(tmp_path / "a.npz")
    assert set(names) == {
        *("t", "span", "half", "big", "on", "row", "structured.x"),
        *("fortran[0]", "fortran[1]", "structured.inner.v[0]", "structured.inner.v[1]"),
    }
    assert values["t"][0] == start.astype(np.int64) / 1e3
    np.testing.assert_array_equal(np.diff(values["t"]), [0.25, 0.25])
    np.testing.assert_array_equal(values["span"], [1e-6, 2e-6, np.nan])
    np.testing.assert_array_equal(values["fortran[1]"], [1, 3, 5])
    np.testing.assert_array_equal(values["structured.inner.v[1]"], [1, 3, 5])


def test_topic_of_a_format_without_topics(tmp_path):
    np.savez(tmp_path / "a.npz", t=np.arange(3.0))
    assert "expected no 'topic' for a NumPy file" in refused(tmp_path / "a.npz", "a")


def test_pieces_of_large_arrays(tmp_path, monkeypatch):
    """Read here, in pieces of a few rows, with columns of one array together."""
    monkeypatch.setattr("steelyard.logs.arrays.nested._PIECE", 7)
    rng = np.random.default_rng(3)
    a, t = rng.normal(size=(100, 3)), np.arange(100.0)
    with h5py.File(tmp_path / "a.h5", "w") as file:
        file["t"], file["a"] = t, a
    with hdf5.arrays_here(tmp_path / "a.h5", None) as arrays:
        values = arrays.log(None).read(["a[2]", "t", "a[0]"], RowRange("t", 10.5, 77))
    np.testing.assert_array_equal(values["a[2]"], a[11:78, 2])
    np.testing.assert_array_equal(values["a[0]"], a[11:78, 0])


# Damaged files


HERE = ["json.mcap", "ros2.mcap", "ros1.bag", "old.db3", "imu.npz"]
IN_SUBPROCESS = ["a.h5", "v5.mat", "v73.mat", "a.tdms"]


def attempt(path, topic):
    """Whether a file can be read; anything but a sentence fails the test."""
    sentence = None
    try:
        # Errors of whatever kind are seen where Python alone reads.
        opened = format_of(path).opened if path.name in HERE else open_log
        with opened(path, topic) as log:
            log.read(log.names)
    except InputError as error:
        sentence = str(error)
    assert sentence is None or (str(path) in sentence and "\n" not in sentence)
    return sentence is None


@pytest.mark.parametrize("name", HERE)
def test_cut_off_anywhere(small, tmp_path_factory, name):
    path, topic = small[name]
    content = path.read_bytes()
    cut = tmp_path_factory.mktemp("cut") / path.name

    @settings(max_examples=40, deadline=None, suppress_health_check=list(HealthCheck))
    @given(st.integers(0, len(content) - 1))
    def check(length):
        cut.write_bytes(content[:length])
        assert not attempt(cut, topic)

    check()


@pytest.mark.integration
@pytest.mark.parametrize("name", IN_SUBPROCESS)
@pytest.mark.parametrize("fraction", [0.0, 0.3, 0.999])
def test_cut_off(small, tmp_path, name, fraction):
    path, topic = small[name]
    content = path.read_bytes()
    cut = tmp_path / path.name
    cut.write_bytes(content[: int(len(content) * fraction)])
    assert not attempt(cut, topic)


@pytest.mark.integration
@pytest.mark.parametrize("name", HERE)
def test_changed_anywhere(small, tmp_path_factory, name):
    path, topic = small[name]
    content = path.read_bytes()
    changed = tmp_path_factory.mktemp("changed") / path.name

    @settings(max_examples=60, deadline=None, suppress_health_check=list(HealthCheck))
    @given(
        st.lists(
            st.tuples(st.integers(0, len(content) - 1), st.integers(0, 255)), min_size=1, max_size=4
        )
    )
    def check(changes):
        damaged = bytearray(content)
        for place, value in changes:
            damaged[place] = value
        changed.write_bytes(damaged)
        attempt(changed, topic)

    check()


@pytest.mark.integration
@pytest.mark.parametrize("name", IN_SUBPROCESS)
@pytest.mark.parametrize("seed", [1, 2])
def test_changed(small, tmp_path, name, seed):
    path, topic = small[name]
    rng = np.random.default_rng(seed)
    damaged = bytearray(path.read_bytes())
    for place in rng.integers(0, 2000, 4 * seed):
        damaged[place] = int(rng.integers(256))
    changed = tmp_path / path.name
    changed.write_bytes(damaged)
    attempt(changed, topic)


@pytest.mark.parametrize(
    "name",
    [*HERE, *(pytest.param(name, marks=pytest.mark.integration) for name in IN_SUBPROCESS)],
)
def test_noise_behind_the_beginning(small, tmp_path, name):
    path, topic = small[name]
    noisy = tmp_path / path.name
    noisy.write_bytes(path.read_bytes()[:20] + np.random.default_rng(0).bytes(5000))
    assert not attempt(noisy, topic)


@pytest.mark.slow
@pytest.mark.long
@pytest.mark.integration
def test_checksums(small, tmp_path, found):
    """What a format can notice, it does: the numbers of an MCAP file are right, or it is
    refused."""
    path, topic = small["ros2.mcap"]
    content = path.read_bytes()
    rng = np.random.default_rng(4)
    for place in rng.integers(9, len(content) // 2, 40):
        damaged = bytearray(content)
        damaged[place] ^= 1 << int(rng.integers(8))
        (tmp_path / "a.mcap").write_bytes(damaged)
        try:
            _, values = read(tmp_path / "a.mcap", topic, ["angular_velocity.x"])
        except InputError:
            continue
        np.testing.assert_array_equal(values["angular_velocity.x"], found["imu"]["wx"])


@pytest.mark.parametrize(
    ("name", "repair"),
    [
        ("json.mcap", "mcap recover json.mcap -o"),
        ("ros1.bag", "rosbag reindex ros1.bag"),
        ("old.db3", "sqlite3 old.db3 .recover"),
        ("a.tdms", "open it in LabVIEW and save it again"),
    ],
)
def test_how_to_repair(small, tmp_path, name, repair):
    path, topic = small[name]
    content = path.read_bytes()
    (tmp_path / name).write_bytes(content[: int(len(content) * 0.9)])
    sentence = refused(tmp_path / name, topic)
    assert "cut off" in sentence
    assert repair in sentence


def test_bag_that_was_not_closed(small, tmp_path):
    """As a recorder that crashed leaves it: the place of the index is zero."""
    content = small["ros1.bag"][0].read_bytes()
    place = content.index(b"index_pos=") + 10
    (tmp_path / "a.bag").write_bytes(content[:place] + bytes(8) + content[place + 8 :])
    assert "rosbag reindex a.bag" in refused(tmp_path / "a.bag")


def test_messages_that_the_database_has_not_taken_over(small, tmp_path):
    path, topic = small["old.db3"]
    (tmp_path / "a.db3").write_bytes(path.read_bytes())
    (tmp_path / "a.db3-wal").write_bytes(b"x" * 100)
    assert "found messages left in a.db3-wal, since the recorder was stopped" in refused(
        tmp_path / "a.db3", topic
    )


def test_messages_in_an_encoding_that_is_not_read(tmp_path):
    files.write_mcap(
        tmp_path / "a.mcap",
        {"/a": ("protobuf", ("x.Pose", "protobuf", "\x0a\x00"))},
        [("/a", 10**9, b"\x08\x01")],
    )
    assert (
        "topic '/a': expected messages in JSON or of ROS (cdr, ros1), found 'protobuf'"
        in refused(tmp_path / "a.mcap")
    )


@pytest.mark.parametrize(
    ("name", "package", "module"),
    [
        ("json.mcap", "mcap", "mcap"),
        ("ros1.bag", "rosbags", "rosbags"),
        ("old.db3", "rosbags", "rosbags"),
        ("a.h5", "h5py", "h5py"),
        ("v73.mat", "h5py", "h5py"),
        ("a.tdms", "npTDMS", "nptdms"),
    ],
)
def test_library_that_is_not_installed(small, monkeypatch, name, package, module):
    found = importlib.util.find_spec
    monkeypatch.setattr(
        "steelyard.logs.packages.find_spec", lambda name: None if name == module else found(name)
    )
    sentence = refused(*small[name])
    assert (
        f'files needs the package {package}; install it with: pip install "steelyard[all]"'
        in sentence
    )


# Hostile files. What takes seconds to pack is packed when its test runs, not when it is collected.


@cache
def zeros_by_lz4():
    return lz4.frame.compress(bytes(1 << 27))


@cache
def zeros_by_bz2():
    return bz2.compress(bytes(1 << 27))


def hostile(path, topic=None):
    """The sentence with which a file is refused, with little work."""
    with bounded(LONGEST):
        return refused(path, topic)


def rewritten_chunks(path, change):
    """Replace the chunks of an MCAP file; a change gives compression, size and packed bytes."""
    content, place, out = path.read_bytes(), 8, [path.read_bytes()[:8]]
    while place < len(content) - 8:
        opcode, length = struct.unpack_from("<BQ", content, place)
        record = content[place + 9 : place + 9 + length]
        if opcode == 6:
            start, end, _, _, text = struct.unpack_from("<QQQII", record)
            compression, size, packed = change(record[32 + text + 8 :])
            record = struct.pack("<QQQII", start, end, size, 0, len(compression)) + compression
            record += struct.pack("<Q", len(packed)) + packed
        out.append(struct.pack("<BQ", opcode, len(record)) + record)
        place += 9 + length
    path.write_bytes(b"".join(out) + content[-8:])


@pytest.mark.parametrize(
    ("compression", "size", "packed", "sentence"),
    [
        (b"zstd", 2**60, b"x", "a chunk of 1152921504606846976 bytes"),
        (b"zstd", 1 << 25, b"\x28\xb5\x2f\xfd", "KiB that unpack to more than"),
        (b"lz4", 1 << 27, zeros_by_lz4, "KiB that unpack to more than"),
        (b"lz4", 100, zeros_by_lz4, "does not unpack to its 100 bytes"),
        (
            b"zstd",
            100,
            b"\x28\xb5\x2f\xfd\xe0" + struct.pack("<Q", 2**40),
            "a block that states 1099511627776 bytes",
        ),
        (b"snappy", 100, b"x", "compression 'snappy'"),
        (
            b"",
            100,
            b"\x05" + struct.pack("<Q", 2**63) + bytes(91),
            "a record that runs over the end",
        ),
    ],
)
def test_hostile_chunks(tmp_path, compression, size, packed, sentence):
    path = json_topic(tmp_path / "a.mcap", ['{"a": 1}'])
    content = packed() if callable(packed) else packed
    rewritten_chunks(path, lambda _: (compression, size, content))
    assert sentence in hostile(path)


@pytest.mark.slow
@pytest.mark.integration
def test_many_small_messages(tmp_path):
    """A few kilobytes that unpack to messages without end."""
    messages = [("/a", 10**9, b"{}")] * 600_000
    files.write_mcap(
        tmp_path / "a.mcap",
        {"/a": ("json", None)},
        messages,
        chunk_size=1 << 22,
        index_types=IndexType.NONE,
    )
    assert (tmp_path / "a.mcap").stat().st_size < 1 << 18
    assert "that unpack to more than" in hostile(tmp_path / "a.mcap")


def test_record_that_states_any_length(tmp_path):
    (tmp_path / "a.mcap").write_bytes(
        mcap.MAGIC + b"\x05" + struct.pack("<Q", 2**62) + bytes(40) + mcap.MAGIC
    )
    assert "a record of 4611686018427387904 bytes" in hostile(tmp_path / "a.mcap")


def nested_types(depth, width):
    """A type of types of types, ten of each: a few lines that define any number of fields."""
    parts = ["\n".join(f"a/T0 f{i}" for i in range(width))]
    parts += [
        f"MSG: a/T{d}\n" + "\n".join(f"a/T{d + 1} f{i}" for i in range(width)) for d in range(depth)
    ]
    return ("\n" + "=" * 80 + "\n").join([*parts, f"MSG: a/T{depth}\nstring x"])


def idl(fields):
    return "module a { module msg { struct A {" + fields + "}; }; };"


@pytest.mark.slow
@pytest.mark.integration
@pytest.mark.parametrize(
    ("form", "definition", "sentence"),
    [
        ("ros2msg", nested_types(9, 10), "a type of more than 100000 fields"),
        ("ros2msg", "a/A x", "a type within itself"),
        ("ros2msg", "float64[2000000000] x", "a length beyond its end"),
        ("ros2msg", "string[2000000000] x", "buffer"),
        ("ros2msg", "a/B[2000000000] x\n" + "=" * 80 + "\nMSG: a/B\nfloat64 y", "buffer"),
        ("ros2msg", "a/Unknown x", "the type a/msg/Unknown, which is not defined"),
        ("ros2msg", "wstring x", "not defined"),
        ("ros2msg", "import os; os.system('x')", "one that cannot be read"),
        ("ros2msg", "float64 x\n" * 100_000, "1000000 characters"),
        ("ros2msg", "a/" * 100_000, "one that cannot be read"),
        ("ros2idl", "const long A = " + "(" * 30 + "1" + ")" * 30 + ";", "expressions to evaluate"),
        ("ros2idl", "const long A = 1 << 100000000000;", "expressions to evaluate"),
        ("ros2idl", "module " * 5000, "one that cannot be read"),
        ("ros2idl", "@a(b=1) " * 3000, "expected a definition"),
        ("ros2idl", "".join(f"const long A{i} = 1;" for i in range(1000)), "found none"),
        ("ros2idl", idl("sequence<" * 20 + "double" + ">" * 20 + " x;"), "a sequence of sequences"),
        ("ros2idl", idl("double x" + "[2]" * 5000 + ";"), "an array of arrays"),
        ("ros2idl", idl("double x[2];" * 10_000), "buffer"),
        ("ros2idl", "typedef B C; typedef C B; " + idl("B x;"), "stands for itself"),
        ("ros2idl", "struct {" * 10_000, "in place of a name"),
        ("ros2idl", "@a(" * 80_000, "cut off"),
        ("ros2idl", "module a { struct A { double x; }; }; " * 800, "expected a definition"),
    ],
)
def test_hostile_definitions(tmp_path, form, definition, sentence):
    files.write_mcap(
        tmp_path / "a.mcap",
        {"/a": ("cdr", ("a/msg/A", form, definition))},
        [("/a", 10**9, b"\x00\x01\x00\x00" + bytes(64))],
    )
    assert sentence in hostile(tmp_path / "a.mcap")


@pytest.mark.parametrize(
    "data", [b"", b"\x00\x03\x00\x00" + bytes(400), b"\x00\x01\x00\x00" + b"\xff" * 400]
)
def test_hostile_messages(tmp_path, data):
    kind = files.TYPES["cables"]
    files.write_mcap(
        tmp_path / "a.mcap",
        {"/a": ("cdr", (kind, "ros2msg", files.definition(kind)))},
        [("/a", 10**9, data)],
    )
    assert "message 1 of topic '/a': expected one of type sensor_msgs/msg/JointState" in hostile(
        tmp_path / "a.mcap"
    )


def test_names_that_steer_a_terminal(tmp_path):
    channels = {"/a\x1b[2J": ("json", None), "/b\n": ("json", None)}
    files.write_mcap(
        tmp_path / "a.mcap", channels, [(topic, 10**9, b'{"x": 1}') for topic in channels]
    )
    assert "\x1b" not in hostile(tmp_path / "a.mcap")
    assert "\x1b" not in hostile(tmp_path / "a.mcap", "/c\x1b")


def rosbag_chunk(path, packed, size, compression):
    """A bag of one chunk."""

    def record(fields, data):
        head = b"".join(
            struct.pack("<I", len(k) + 1 + len(v)) + k + b"=" + v for k, v in fields.items()
        )
        return struct.pack("<I", len(head)) + head + struct.pack("<I", len(data)) + data

    magic = b"#ROSBAG V2.0\n"
    chunk = record(
        {b"op": b"\x05", b"compression": compression, b"size": struct.pack("<I", size)}, packed
    )
    about = {b"topic": b"/a", b"type": b"std_msgs/Float64", b"message_definition": b"float64 data"}
    about = b"".join(
        struct.pack("<I", len(k) + 1 + len(v)) + k + b"=" + v for k, v in about.items()
    )
    connection = record({b"op": b"\x07", b"conn": bytes(4), b"topic": b"/a"}, about)

    def head(index):
        counts = {b"conn_count": struct.pack("<I", 1), b"chunk_count": struct.pack("<I", 1)}
        return magic + record(
            {b"op": b"\x03", b"index_pos": struct.pack("<Q", index), **counts}, b" " * 100
        )

    place = len(head(0))
    info = {
        b"op": b"\x06",
        b"ver": struct.pack("<I", 1),
        b"chunk_pos": struct.pack("<Q", place),
        b"count": struct.pack("<I", 1),
    }
    times = {b"start_time": struct.pack("<II", 1, 0), b"end_time": struct.pack("<II", 2, 0)}
    path.write_bytes(
        head(place + len(chunk))
        + chunk
        + connection
        + record({**info, **times}, struct.pack("<II", 0, 1))
    )


@pytest.mark.slow
@pytest.mark.integration
@pytest.mark.parametrize(
    ("compression", "size", "packed", "sentence"),
    [
        (b"bz2", 1 << 27, zeros_by_bz2, "that unpack to more than"),
        (b"bz2", 100, zeros_by_bz2, "does not unpack to its 100 bytes"),
        (b"lz4", 2**32 - 1, b"x", "a chunk of 4294967295 bytes"),
        (b"none", 4, b"\xff\xff\xff\xff", "a header that runs over the end of its chunk"),
    ],
)
def test_hostile_bags(tmp_path, compression, size, packed, sentence):
    content = packed() if callable(packed) else packed
    rosbag_chunk(tmp_path / "a.bag", content, size, compression)
    assert sentence in hostile(tmp_path / "a.bag", "a")


@pytest.mark.integration
@pytest.mark.parametrize(
    ("script", "sentence"),
    [
        (
            (
                "ALTER TABLE messages RENAME TO old; CREATE VIEW messages AS WITH RECURSIVE c(i) AS"
                " (SELECT 1 UNION ALL SELECT i + 1 FROM c) SELECT i AS id, 1 AS topic_id, i AS"
                " timestamp, x'00' AS data FROM c"
            ),
            "expected a bag of ROS 2 with the tables messages and topics, found old, topics",
        ),
        (
            "ALTER TABLE messages ADD COLUMN more GENERATED ALWAYS AS (zeroblob(500000000))",
            "a computed column in 'messages'",
        ),
        (
            "DROP TABLE topics",
            "expected a bag of ROS 2 with the tables messages and topics, found messages",
        ),
        ("UPDATE messages SET data = 'text'", "a message that is no bytes with a time"),
        ("UPDATE messages SET timestamp = 'noon'", "a message that is no bytes with a time"),
        (
            "UPDATE topics SET serialization_format = 'protobuf'",
            "expected messages in cdr, found 'protobuf'",
        ),
        (
            "UPDATE topics SET type = 'my_msgs/msg/Unknown'",
            "expected a definition of the type my_msgs/msg/Unknown",
        ),
        pytest.param(
            "UPDATE messages SET data = zeroblob(3000000)",
            "expected one of type",
            marks=pytest.mark.integration,
        ),
    ],
)
def test_hostile_databases(small, tmp_path, script, sentence):
    (tmp_path / "a.db3").write_bytes(small["old.db3"][0].read_bytes())
    connection = sqlite3.connect(tmp_path / "a.db3")
    connection.executescript(script)
    connection.close()
    assert sentence in hostile(tmp_path / "a.db3", "/imu")


@pytest.mark.slow
@pytest.mark.integration
def test_parts_of_a_bag_are_in_its_folder(small, tmp_path):
    (tmp_path / "secret.db3").write_bytes(small["old.db3"][0].read_bytes())
    bag = tmp_path / "bag"
    bag.mkdir()
    (bag / "metadata.yaml").write_text(
        "rosbag2_bagfile_information: {storage_identifier: sqlite3, relative_file_paths:"
        " [../secret.db3]}\n"
    )
    with pytest.raises(
        InputError, match=r"bag.secret\.db3: expected a part of the bag, found nothing there"
    ):
        read(bag, "imu")
    for text in (
        "[]",
        "rosbag2_bagfile_information: 3",
        "rosbag2_bagfile_information: {relative_file_paths: x}",
    ):
        (bag / "metadata.yaml").write_text(text)
        with pytest.raises(InputError, match="relative_file_paths"):
            read(bag, "imu")
    (bag / "metadata.yaml").write_text(
        "rosbag2_bagfile_information: {storage_identifier: sqlite3, relative_file_paths:"
        " [a.db3.zstd], compression_mode: FILE}"
    )
    with pytest.raises(InputError, match="convert it with: ros2 bag convert"):
        read(bag, "imu")


def secret(folder):
    """A file that another one must not lead to."""
    (folder / "secret").write_bytes(np.full(10, 42.0).tobytes())
    with h5py.File(folder / "secret.h5", "w") as file:
        file["x"] = np.full(10, 42.0)
    return folder / "secret"


def external_link(file, folder):
    file["x"] = h5py.ExternalLink(str(secret(folder)) + ".h5", "/x")


def external_storage(file, folder):
    file.create_dataset("x", (10,), float, external=[(str(secret(folder)), 0, 80)])


def virtual(file, folder):
    layout = h5py.VirtualLayout((10,), float)
    layout[:] = h5py.VirtualSource(str(secret(folder)) + ".h5", "x", (10,))
    file.create_virtual_dataset("x", layout)


def link_circle(file, folder):
    file["a"] = h5py.SoftLink("/b")
    file["b"] = h5py.SoftLink("/a")
    group = file.create_group("c")
    group["again"] = group
    group["up"] = file["/"]


def references(file, folder):
    file["y"] = np.arange(3.0)
    file.create_dataset("x", (1,), h5py.ref_dtype)[0] = file["y"].ref
    del file["y"]


def plugin(file, folder):
    creation = h5py.h5p.create(h5py.h5p.DATASET_CREATE)
    creation.set_chunk((8,))
    creation.set_filter(32015, h5py.h5z.FLAG_OPTIONAL)
    h5py.h5d.create(file.id, b"x", h5py.h5t.NATIVE_DOUBLE, h5py.h5s.create_simple((8,)), creation)


@pytest.mark.integration
@pytest.mark.parametrize(
    ("make", "left"),
    [
        (external_link, " (left out: x: a link)"),
        (external_storage, " (left out: x: in another file)"),
        (virtual, " (left out: x: in another file)"),
        (plugin, " (left out: x: packed by filter 32015)"),
        (link_circle, " (left out: a: a link, b: a link)"),
        (references, ""),
    ],
)
def test_hdf5_files_lead_nowhere_else(tmp_path, make, left):
    with h5py.File(tmp_path / "a.h5", "w") as file:
        make(file, tmp_path)
    assert (
        f"expected arrays of numbers with an instant per row, found none{left}; check"
        in hostile(tmp_path / "a.h5")
    )


def bombs(file):
    file.create_dataset("x", (10_000_000, 1000), float, fillvalue=1.0, chunks=(1000, 100))


def deflated(file):
    file.create_dataset("x", data=np.zeros(1 << 25), compression="lzf", chunks=(1 << 20,))


def one_chunk(file):
    file.create_dataset(
        "x", (1 << 28,), float, chunks=(1 << 28,), compression="gzip", maxshape=(None,)
    )


def wide(file):
    file["x"] = np.zeros((2, 100_000), np.float32)


def odd_names(file):
    file["a\x1b[2J/x"] = np.arange(3.0)
    file["b\n/x"] = np.arange(3.0)


@pytest.mark.slow
@pytest.mark.integration
@pytest.mark.parametrize(
    ("make", "sentence"),
    [
        (bombs, "that unpack to more than"),
        (deflated, "that unpack to more than"),
        (one_chunk, "that unpack to more than"),
        (wide, "left out: x: more than 1000 numbers at an instant"),
        (odd_names, "which of its groups to read, found a\ufffd[2J, b\ufffd"),
    ],
)
def test_hostile_hdf5(tmp_path, make, sentence):
    with h5py.File(tmp_path / "a.h5", "w", libver="latest") as file:
        make(file)
    assert sentence in hostile(tmp_path / "a.h5")


@pytest.mark.slow
@pytest.mark.integration
def test_chunk_that_unpacks_to_more_than_it_is(tmp_path):
    """A chunk of eight kilobytes, by its form, whose packed bytes go on and on."""
    packer = zlib.compressobj(9)
    first, again = (
        packer.compress(bytes(1 << 24)) + packer.flush(zlib.Z_FULL_FLUSH) for _ in range(2)
    )
    packed = first + 99 * again
    with h5py.File(tmp_path / "a.h5", "w") as file:
        dataset = file.create_dataset("x", (1024,), float, chunks=(1024,), compression="gzip")
        dataset.id.write_direct_chunk((0,), packed)
    with bounded(LONGEST):
        assert not attempt(tmp_path / "a.h5", None)


def mat_element(kind, data):
    return struct.pack("<II", kind, len(data)) + data + bytes(-len(data) % 8)


def mat_matrix(number, shape, name, *parts):
    head = mat_element(6, struct.pack("<II", number, 0)) + mat_element(
        5, struct.pack(f"<{len(shape)}i", *shape)
    )
    return mat_element(14, head + mat_element(1, name) + b"".join(parts))


MAT_HEADER = b"MATLAB 5.0 MAT-file".ljust(124) + b"\x00\x01IM"


@pytest.mark.slow
@pytest.mark.integration
@pytest.mark.parametrize(
    "content",
    [
        mat_matrix(6, (2**30, 2**30), b"x", mat_element(9, bytes(80))),
        mat_matrix(6, (10, 1), b"x", struct.pack("<II", 9, 2**32 - 8)),
        mat_matrix(1, (2**30, 1), b"x"),
        mat_matrix(
            2,
            (1, 1),
            b"x",
            struct.pack("<HHi", 5, 4, 8),
            mat_element(1, b"c".ljust(8, b"\0")),
            mat_matrix(1, (2**30, 1), b""),
        ),
        lambda: mat_element(15, zlib.compress(bytes(1 << 29))),
        mat_element(15, b"nothing packed"),
        mat_matrix(17, (1, 1), b"x"),
    ],
)
def test_hostile_mat_files(tmp_path, content):
    packed = content() if callable(content) else content
    (tmp_path / "a.mat").write_bytes(MAT_HEADER + packed)
    hostile(tmp_path / "a.mat")


def tdms_segment(metadata, data=b"", following=None, flags=0x0E):
    lead = b"TDSm" + struct.pack(
        "<IIQQ",
        flags,
        4713,
        len(metadata) + len(data) if following is None else following,
        len(metadata),
    )
    return lead + metadata + data


def tdms_object(path, number, kind=10):
    name = path.encode()
    return struct.pack("<I", len(name)) + name + struct.pack("<IIIQI", 20, kind, 1, number, 0)


@pytest.mark.integration
@pytest.mark.parametrize(
    "content",
    [
        tdms_segment(struct.pack("<I", 1) + tdms_object("/'a'/'x'", 2**60), bytes(80)),
        tdms_segment(struct.pack("<I", 2**32 - 1)),
        tdms_segment(struct.pack("<I", 1) + tdms_object("/'a'/'x'", 10, kind=999), bytes(80)),
        tdms_segment(
            struct.pack("<I", 1) + tdms_object("/'a'/'x'", 10), bytes(80), following=2**63
        ),
        tdms_segment(struct.pack("<II", 1, 2**32 - 1)),
    ],
)
def test_hostile_tdms_files(tmp_path, content):
    (tmp_path / "a.tdms").write_bytes(content)
    hostile(tmp_path / "a.tdms")


@pytest.mark.integration
def test_segments_that_repeat_many_objects(tmp_path):
    """Every segment of a few bytes goes on with thousands of channels."""
    objects = [tdms_object(f"/'a'/'x{i}'", 1) for i in range(5000)]
    first = tdms_segment(
        struct.pack("<I", len(objects)) + b"".join(objects), bytes(8 * len(objects))
    )
    (tmp_path / "a.tdms").write_bytes(
        first + tdms_segment(struct.pack("<I", 0), flags=0x0A) * 50_000
    )
    assert "expected at most 2000000 channels in all of its segments" in hostile(
        tmp_path / "a.tdms"
    )


def npy(header, data=b""):
    text = header.encode().ljust(117) + b"\n"
    return b"\x93NUMPY\x01\x00" + struct.pack("<H", len(text)) + text + data


@pytest.mark.parametrize(
    ("content", "sentence"),
    [
        (
            npy("{'descr': '<f8', 'fortran_order': False, 'shape': (1000000000000,)}", bytes(80)),
            "in 208 bytes",
        ),
        (npy("{'descr': '<f8', 'fortran_order': False, 'shape': (-1,)}"), "damaged"),
        (
            npy(
                "{'descr': '|O', 'fortran_order': False, 'shape': (3,)}", b"cos\nsystem\n(S'x'\ntR."
            ),
            "which are never read",
        ),
        (
            npy("{'descr': [('a', '|O'), ('b', '<f8')], 'fortran_order': False, 'shape': (3,)}"),
            "which are never read",
        ),
        (npy("(" * 100 + ")" * 10), "damaged"),
        (npy("__import__('os').system('x')"), "damaged"),
        (npy("{'descr': '<f8', 'fortran_order': False, 'shape': ()}", bytes(8)), "found none"),
        (b"", "damaged"),
        (b"\x93NUMPY\x09\x00", "version"),
    ],
)
def test_hostile_arrays(tmp_path, content, sentence):
    with zipfile.ZipFile(tmp_path / "a.npz", "w") as archive:
        archive.writestr("x.npy", content)
    assert sentence in hostile(tmp_path / "a.npz")


@pytest.mark.integration
def test_archive_that_unpacks_to_too_much(tmp_path):
    with (
        zipfile.ZipFile(tmp_path / "a.npz", "w", zipfile.ZIP_DEFLATED) as archive,
        archive.open("x.npy", "w") as member,
    ):
        member.write(npy(f"{{'descr': '<f8', 'fortran_order': False, 'shape': ({1 << 25},)}}"))
        for _ in range(256):
            member.write(bytes(1 << 20))
    assert (tmp_path / "a.npz").stat().st_size < 1 << 20
    assert "that unpack to more than" in hostile(tmp_path / "a.npz")


@pytest.mark.integration
def test_archive_of_many_arrays(tmp_path):
    content = io.BytesIO()
    np.lib.format.write_array(content, np.zeros(1))
    with zipfile.ZipFile(tmp_path / "a.npz", "w") as archive:
        for i in range(11_000):
            archive.writestr(f"x{i}.npy", content.getvalue())
    assert "expected at most 10000 arrays, found 11000" in hostile(tmp_path / "a.npz")


def test_nothing_beside_a_log_is_executed(small, tmp_path, monkeypatch):
    """A folder of recordings may hold modules with the names of libraries."""
    for name in ("h5py", "numpy", "json"):
        (tmp_path / f"{name}.py").write_text(f"open({str(tmp_path / 'executed')!r}, 'w')\n")
    (tmp_path / "a.h5").write_bytes(small["a.h5"][0].read_bytes())
    monkeypatch.chdir(tmp_path)
    assert len(read("a.h5", "imu")[1]["t"]) == 43
    assert not (tmp_path / "executed").exists()


def test_reader_that_fails_altogether(small, tmp_path, monkeypatch):
    """What a library does to its process stays there."""
    # A module that serves nothing, for a pool that has no reader yet.
    monkeypatch.setattr("steelyard.logs.fence._OTHER_END", "steelyard.logs.size")
    monkeypatch.setattr("steelyard.logs.fence._idle", deque())
    assert "on which its library fails" in refused(*small["a.h5"])


@pytest.mark.integration
def test_readers_print_nothing(small, tmp_path, capfd):
    for path, topic in small.values():
        damaged = tmp_path / path.name
        damaged.write_bytes(path.read_bytes()[:-100] + b"x" * 100)
        attempt(damaged, topic)
    assert capfd.readouterr() == ("", "")


@pytest.mark.skipif(not Path("/proc/kmsg").exists(), reason="no such pipe on this system")
def test_a_link_to_a_pipe_of_the_kernel_is_not_opened(tmp_path):
    (tmp_path / "a.csv").symlink_to("/proc/kmsg")
    with bounded(5), pytest.raises(InputError, match="expected a log, found an empty file"):
        read(tmp_path / "a.csv")
