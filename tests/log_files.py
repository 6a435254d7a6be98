"""Recordings of three instruments, written in every format by the libraries of these formats."""

import gzip
import json
import sqlite3
from functools import cache
from pathlib import Path

import h5py
import numpy as np
import polars as pl
from mcap.writer import CompressionType, Writer
from nptdms import ChannelObject, TdmsWriter
from rosbags.rosbag1 import Writer as Bag1
from rosbags.rosbag2 import StoragePlugin
from rosbags.rosbag2 import Writer as Bag2
from rosbags.typesys import Stores, get_typestore
from scipy.io import savemat

CABLES = 8
DELAY = 3_000_000
"""From the stamp of a message until it is recorded [ns]."""
TYPES = {
    "cables": "sensor_msgs/msg/JointState",
    "imu": "sensor_msgs/msg/Imu",
    "tracker": "geometry_msgs/msg/PointStamped",
}


@cache
def store(ros1=False):
    return get_typestore(Stores.ROS1_NOETIC if ros1 else Stores.ROS2_HUMBLE)


def streams(n=40, seed=5):
    """Three tables with columns of the contract; times in whole microseconds."""
    rng = np.random.default_rng(seed)
    found = {}
    for i, (name, columns) in enumerate(
        {
            "cables": [f"f{j + 1}" for j in range(CABLES)],
            "imu": ["wx", "wy", "wz", "ax", "ay", "az", "qw", "qx", "qy", "qz"],
            "tracker": ["x", "y", "z"],
        }.items()
    ):
        rows = n + 3 * i
        table = {"t": (np.arange(rows) * 10_000 + rng.integers(0, 5000, rows) + 1_000_000) / 1e6}
        table |= {column: rng.normal(size=rows) for column in columns}
        if name == "imu":
            q = np.column_stack([table[c] for c in ("qw", "qx", "qy", "qz")])
            q /= np.linalg.norm(q, axis=1)[:, None]
            table |= {c: q[:, j].copy() for j, c in enumerate(("qw", "qx", "qy", "qz"))}
        found[name] = table
    return found


def nanoseconds(t):
    return round(float(t) * 1e6) * 1000


def stamp(ns):
    return {"sec": ns // 10**9, "nanosec": ns % 10**9}


def in_order(found):
    """Name, row and time [ns] of all rows in the order of time."""
    rows = [
        (nanoseconds(t), name, i) for name, table in found.items() for i, t in enumerate(table["t"])
    ]
    return [(name, i, ns) for ns, name, i in sorted(rows)]


# Text and tables


def write_csv(path, table, *, separator=",", comma=False, units=None):
    lines = [separator.join(table)]
    if units:
        lines.append(separator.join(units.get(name, "") for name in table))
    for row in zip(*table.values(), strict=True):
        cells = [repr(float(value)) for value in row]
        lines.append(separator.join(cell.replace(".", ",") if comma else cell for cell in cells))
    text = "\n".join(lines) + "\n"
    if path.suffix == ".gz":
        path.write_bytes(gzip.compress(text.encode()))
    elif comma:
        path.write_bytes(text.encode("utf-16"))
    else:
        path.write_text(text)


def write_parquet(path, table):
    pl.DataFrame(table).write_parquet(path)


# Messages


def as_json(name, table, i, ns):
    """A message as a dictionary, in the manner of ROS."""
    header = {"stamp": stamp(ns), "frame_id": name}
    value = {column: float(values[i]) for column, values in table.items()}
    if name == "cables":
        effort = [value[f"f{j + 1}"] for j in range(CABLES)]
        return {"header": header, "name": [f"c{j}" for j in range(CABLES)], "effort": effort}
    if name == "tracker":
        return {"header": header, "point": {axis: value[axis] for axis in "xyz"}}
    return {
        "header": header,
        "orientation": {axis: value[f"q{axis}"] for axis in "xyzw"},
        "angular_velocity": {axis: value[f"w{axis}"] for axis in "xyz"},
        "linear_acceleration": {axis: value[f"a{axis}"] for axis in "xyz"},
    }


def header(kinds, ns, frame, ros1):
    time = kinds.types["builtin_interfaces/msg/Time"](**stamp(ns))
    number = {"seq": 7} if ros1 else {}
    return kinds.types["std_msgs/msg/Header"](**number, stamp=time, frame_id=frame)


def as_ros(name, table, i, ns, ros1=False, covariance=0.0):
    """A message of ROS."""
    kinds = store(ros1)
    value = {column: float(values[i]) for column, values in table.items()}
    # Texts of different lengths put the numbers behind them at other places.
    head = header(kinds, ns, "frame" + "x" * (i % 5), ros1)
    if name == "cables":
        effort = np.array([value[f"f{j + 1}"] for j in range(CABLES)])
        names = [f"cable {j}" for j in range(CABLES)]
        return kinds.types[TYPES[name]](head, names, np.empty(0), np.empty(0), effort)
    vector, point, quaternion = (
        kinds.types[f"geometry_msgs/msg/{kind}"] for kind in ("Vector3", "Point", "Quaternion")
    )
    if name == "tracker":
        return kinds.types[TYPES[name]](head, point(value["x"], value["y"], value["z"]))
    first = np.zeros(9)
    first[0] = covariance
    return kinds.types[TYPES[name]](
        head,
        quaternion(*(value[f"q{axis}"] for axis in "xyzw")),
        first,
        vector(*(value[f"w{axis}"] for axis in "xyz")),
        np.arange(9.0),
        vector(*(value[f"a{axis}"] for axis in "xyz")),
        np.zeros(9),
    )


def write_mcap(path, channels, messages, **options):
    """An MCAP file.

    Args:
        path: Of the file.
        channels: Topic -> encoding of messages, name, encoding and text of the schema (None: no
            schema).
        messages: Topic, time of reception [ns], bytes.
        options: Of the writer.
    """
    options = {"compression": CompressionType.ZSTD, "chunk_size": 4096, **options}
    with path.open("wb") as file:
        writer = Writer(file, **options)
        writer.start("", "test")
        numbers = {}
        for topic, (encoding, schema) in channels.items():
            number = (
                0
                if schema is None
                else writer.register_schema(schema[0], schema[1], schema[2].encode())
            )
            numbers[topic] = writer.register_channel(topic, encoding, number)
        for topic, ns, data in messages:
            writer.add_message(numbers[topic], ns, data, ns - DELAY)
        writer.finish()


def write_mcap_json(path, found, times=None, **options):
    """Messages in JSON, received when they were stamped, or at times of their own [s]."""
    channels = {
        f"/{name}": ("json", (name.title(), "jsonschema", '{"type": "object"}')) for name in found
    }
    messages = []
    for name, i, ns in in_order(found):
        received = ns if times is None else nanoseconds(times[i]) + 10**9
        text = json.dumps(as_json(name, found[name], i, ns))
        messages.append((f"/{name}", received + DELAY, text.encode()))
    write_mcap(path, channels, messages, **options)


def definition(kind, ros1=False):
    return store(ros1).generate_msgdef(kind, ros_version=1 if ros1 else 2)[0]


def write_mcap_ros2(path, found, **options):
    channels = {
        f"/{name}": ("cdr", (TYPES[name], "ros2msg", definition(TYPES[name]))) for name in found
    }
    messages = [
        (
            f"/{name}",
            ns + DELAY,
            bytes(store().serialize_cdr(as_ros(name, found[name], i, ns), TYPES[name])),
        )
        for name, i, ns in in_order(found)
    ]
    write_mcap(path, channels, messages, **options)


def write_mcap_ros1(path, found):
    channels = {
        f"/{name}": (
            "ros1",
            (TYPES[name].replace("/msg", ""), "ros1msg", definition(TYPES[name], ros1=True)),
        )
        for name in found
    }
    messages = [
        (
            f"/{name}",
            ns + DELAY,
            bytes(store(True).serialize_ros1(as_ros(name, found[name], i, ns, True), TYPES[name])),
        )
        for name, i, ns in in_order(found)
    ]
    write_mcap(path, channels, messages)


def write_bag(path, found, compression=None, chunk_size=1 << 20):
    bag = Bag1(path)
    bag.chunk_threshold = chunk_size
    if compression:
        bag.set_compression(compression)
    with bag:
        connections = {
            name: bag.add_connection(f"/{name}", TYPES[name], typestore=store(True))
            for name in found
        }
        for name, i, ns in in_order(found):
            data = store(True).serialize_ros1(as_ros(name, found[name], i, ns, True), TYPES[name])
            bag.write(connections[name], ns + DELAY, bytes(data))


def write_bag2(path, found, storage=StoragePlugin.SQLITE3):
    with Bag2(path, version=9, storage_plugin=storage) as bag:
        connections = {
            name: bag.add_connection(f"/{name}", TYPES[name], typestore=store()) for name in found
        }
        for name, i, ns in in_order(found):
            data = store().serialize_cdr(as_ros(name, found[name], i, ns), TYPES[name])
            bag.write(connections[name], ns + DELAY, bytes(data))


def write_old_database(path, found):
    """A database as recorders before ROS 2 Iron wrote it: without definitions."""
    connection = sqlite3.connect(path)
    connection.executescript("""
        CREATE TABLE topics(id INTEGER PRIMARY KEY, name TEXT NOT NULL, type TEXT NOT NULL, serialization_format TEXT NOT NULL,
          offered_qos_profiles TEXT NOT NULL);
        CREATE TABLE messages(id INTEGER PRIMARY KEY, topic_id INTEGER NOT NULL, timestamp INTEGER NOT NULL, data BLOB NOT NULL);
        CREATE INDEX timestamp_idx ON messages (timestamp ASC);
        """)
    numbers = {name: i + 1 for i, name in enumerate(found)}
    for name, number in numbers.items():
        connection.execute(
            "INSERT INTO topics VALUES (?, ?, ?, 'cdr', '')", (number, f"/{name}", TYPES[name])
        )
    for name, i, ns in in_order(found):
        data = bytes(store().serialize_cdr(as_ros(name, found[name], i, ns), TYPES[name]))
        connection.execute(
            "INSERT INTO messages(topic_id, timestamp, data) VALUES (?, ?, ?)",
            (numbers[name], ns + DELAY, data),
        )
    connection.commit()
    connection.close()


# Arrays


def as_arrays(name, table):
    """Arrays as one would save them: vectors in the columns of a matrix."""

    def matrix(*columns):
        return np.column_stack([table[column] for column in columns])

    if name == "cables":
        return {"t": table["t"], "force": matrix(*(f"f{j + 1}" for j in range(CABLES)))}
    if name == "tracker":
        return {"t": table["t"], "position": matrix("x", "y", "z")}
    return {
        "t": table["t"],
        "gyro": matrix("wx", "wy", "wz"),
        "acc": matrix("ax", "ay", "az"),
        "quaternion": matrix("qw", "qx", "qy", "qz"),
    }


ARRAY_COLUMNS = {
    "cables": {f"f{j + 1}": f"force[{j}]" for j in range(CABLES)},
    "imu": {
        **{f"w{axis}": f"gyro[{j}]" for j, axis in enumerate("xyz")},
        **{f"a{axis}": f"acc[{j}]" for j, axis in enumerate("xyz")},
        **{f"q{axis}": f"quaternion[{j}]" for j, axis in enumerate("wxyz")},
    },
    "tracker": {axis: f"position[{j}]" for j, axis in enumerate("xyz")},
}
"""Columns of the contract -> columns of these arrays."""


def write_hdf5(path, found):
    with h5py.File(path, "w") as file:
        for name, table in found.items():
            group = file.create_group(name)
            for key, array in as_arrays(name, table).items():
                group.create_dataset(key, data=array, compression="gzip", shuffle=True)


def write_mat(path, found, **options):
    # MATLAB has no vectors: times are a column.
    structures = {
        name: {key: array.reshape(len(array), -1) for key, array in as_arrays(name, table).items()}
        for name, table in found.items()
    }
    savemat(path, structures, **options)


def write_mat73(path, found):
    """As MATLAB does it: HDF5 behind a header, axes in the opposite order, structures as groups."""
    with h5py.File(path, "w", userblock_size=512) as file:
        for name, table in found.items():
            group = file.create_group(name)
            group.attrs["MATLAB_class"] = np.bytes_("struct")
            for key, array in as_arrays(name, table).items():
                dataset = group.create_dataset(
                    key, data=array.reshape(len(array), -1).T, compression="gzip"
                )
                dataset.attrs["MATLAB_class"] = np.bytes_("double")
    write_mat73_header(path)


def write_mat73_header(path):
    with path.open("r+b") as file:
        file.write(b"MATLAB 7.3 MAT-file, Platform: GLNXA64".ljust(116) + bytes(8) + b"\x00\x02IM")


def write_tdms(path, found):
    with TdmsWriter(path) as writer:
        for name, table in found.items():
            writer.write_segment(
                [ChannelObject(name, column, values) for column, values in table.items()]
            )


def write_npz(path, table, name, **options):
    (np.savez_compressed if options.get("compressed") else np.savez)(path, **as_arrays(name, table))


def small(folder: Path):
    """A small file of every format with messages or arrays: name of the file -> path, and the topic
    of the inertial measurement unit."""
    found = streams()
    write_mcap_json(folder / "json.mcap", found)
    write_mcap_ros2(folder / "ros2.mcap", found)
    write_bag(folder / "ros1.bag", found)
    write_old_database(folder / "old.db3", found)
    write_hdf5(folder / "a.h5", found)
    write_mat(folder / "v5.mat", found, do_compression=True)
    write_mat73(folder / "v73.mat", found)
    write_tdms(folder / "a.tdms", found)
    write_npz(folder / "imu.npz", found["imu"], "imu", compressed=True)
    return {
        path.name: (path, None if path.suffix == ".npz" else "imu")
        for path in sorted(folder.iterdir())
    }
