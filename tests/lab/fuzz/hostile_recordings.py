"""Hostile recordings: each small beside what it asks for, or no file at all.

``KINDS`` has a function for each kind: it writes a file into a folder, by a random generator, and returns what reads the file.
"""

import bz2
import io
import math
import sqlite3
import struct
import zipfile
from collections.abc import Callable
from functools import partial
from pathlib import Path

import numpy as np
from hostile import Reader, Rng, aliases, large, nested, no_file, put, written
from lz4 import frame as lz4
from rosbag_messages import ODOMETRY, TF, Plugin, header, make, odometry, transform, write_bag

from turtlebot_gym_lab.calibration.tape import read_legs
from turtlebot_gym_lab.drives import read

KINDS: dict[str, Callable[[Path, Rng], Reader]] = {}
"""Kinds of hostile recordings by name."""


def kind(make_file):
    KINDS[make_file.__name__] = make_file
    return make_file


# Bags


def rows(count=40):
    return [
        ("/odom", ODOMETRY, 100.0 + 0.1 * k, odometry(100.0 + 0.1 * k, (0.02 * k, 0.0, 0.0), (0.2, 0.0))) for k in range(count)
    ]


def the_file(folder):
    (file,) = [path for path in folder.iterdir() if path.suffix in (".mcap", ".db3")]
    return file


def record(code, content):
    return bytes([code]) + struct.pack("<Q", len(content)) + content


def text(value):
    return struct.pack("<I", len(value)) + value


def zeros_of(rng, size):
    """Return so many zero bytes, compressed, and the name of the compression."""
    from rosbags.rosbag2.storage_mcap import zstd

    if rng.random() < 0.3:
        return b"lz4", lz4.compress(bytes(min(size, 2 * 10**8)))
    compressor = zstd.ZstdCompressor()
    parts = [compressor.compress(bytes(2**24)) for _ in range(size >> 24)]
    return b"zstd", b"".join([*parts, compressor.compress(bytes(size % 2**24)), compressor.flush()])


def mcap(chunk):
    """Return an MCAP file without a summary that has a chunk."""
    magic = b"\x89MCAP0\r\n"
    return magic + record(1, text(b"ros2") + text(b"")) + chunk + record(15, bytes(4)) + record(2, bytes(20)) + magic


@kind
def mcap_chunk_of_zeros(folder, rng):
    size = large(rng, 8.0, 9.7)
    name, content = zeros_of(rng, size)
    about = struct.pack("<QQQI", 0, 10**9, size, 0) + text(name) + struct.pack("<Q", len(content))
    return partial(read, written(folder / "a.mcap", mcap(record(6, about + content))))


@kind
def mcap_that_lies_about_sizes(folder, rng):
    content = bytearray(the_file(write_bag(folder / "bag", rows(), plugin=Plugin.MCAP)).read_bytes())
    for _ in range(int(rng.integers(1, 6))):
        at = int(rng.integers(8, len(content) - 8))
        content[at : at + 8] = struct.pack("<Q", large(rng, 3.0, 18.0))
    return partial(read, written(folder / "a.mcap", bytes(content)))


def compressed_bag(folder, messages):
    return write_bag(folder, messages, plugin=Plugin.MCAP, compressed=True)


@kind
def bag_of_many_equal_messages(folder, rng):
    message = rows(1)[0]
    return partial(read, compressed_bag(folder / "bag", [message] * large(rng, 4.0, 5.3)))


def scan(size, time=100.0):
    ranges = np.zeros(size, np.float32)
    return make(
        "sensor_msgs/msg/LaserScan", header(time, "laser"), 0.0, 6.0, 0.01, 0.0, 0.1, 0.1, 8.0, ranges, np.zeros(0, np.float32)
    )


@kind
def bag_with_a_scan_of_millions_of_beams(folder, rng):
    messages = [*rows(), ("/scan", "sensor_msgs/msg/LaserScan", 101.0, scan(large(rng, 5.0, 8.2)))]
    return partial(read, compressed_bag(folder / "bag", messages))


@kind
def bag_with_a_map_of_many_cells(folder, rng):
    side = int(math.sqrt(large(rng, 7.0, 8.3)))
    place = make(
        "geometry_msgs/msg/Pose",
        make("geometry_msgs/msg/Point", 0.0, 0.0, 0.0),
        make("geometry_msgs/msg/Quaternion", 0.0, 0.0, 0.0, 1.0),
    )
    info = make("nav_msgs/msg/MapMetaData", header(100.0).stamp, 0.05, side, side, place)
    grid = make("nav_msgs/msg/OccupancyGrid", header(100.0, "map"), info, np.zeros(side * side, np.int8))
    return partial(read, compressed_bag(folder / "bag", [*rows(), ("/map", "nav_msgs/msg/OccupancyGrid", 101.0, grid)]))


@kind
def bag_with_many_transforms_in_one_message(folder, rng):
    one = transform(100.0, (0.0, 0.0, 0.0), "base_footprint")
    messages = [*rows(), ("/tf", TF, 101.0, make(TF, [one] * large(rng, 4.0, 5.7)))]
    return partial(read, compressed_bag(folder / "bag", messages), truth="/tf:base_footprint")


@kind
def bag_whose_definition_nests(folder, rng):
    """Each type of a message holds an array of the type before it."""
    from rosbags.rosbag2.storage_mcap import zstd

    depth = int(rng.integers(3, 40))
    parts = ["own/T0[] parts\n"]
    parts += [f"MSG: own/T{k}\nown/T{k + 1}[{int(rng.integers(2, 2000))}] inner" for k in range(depth)]
    parts += [f"MSG: own/T{depth}\nuint8[] last"]
    definition = ("\n" + "=" * 80 + "\n").join(parts).encode()
    schema = record(3, struct.pack("<H", 1) + text(b"nav_msgs/msg/Odometry") + text(b"ros2msg") + text(definition))
    channel = record(4, struct.pack("<HH", 1, 1) + text(b"/odom") + text(b"cdr") + text(b""))
    message = record(5, struct.pack("<HIQQ", 1, 0, 5, 5) + bytes(4) + struct.pack("<I", large(rng, 3.0, 9.6)) + bytes(10**5))
    inner = schema + channel + message * 3
    content = zstd.compress(inner)
    about = struct.pack("<QQQI", 5, 5, len(inner), 0) + text(b"zstd") + struct.pack("<Q", len(content))
    return partial(read, written(folder / "a.mcap", mcap(record(6, about + content))))


DATABASES = (
    "CREATE VIEW messages AS WITH RECURSIVE c(x) AS (SELECT 1 UNION ALL SELECT x + 1 FROM c) "
    "SELECT x AS id, 1 AS topic_id, x AS timestamp, zeroblob(700) AS data FROM c",
    "CREATE TABLE messages(id INTEGER PRIMARY KEY, topic_id INTEGER, timestamp INTEGER, kept BLOB, "
    "data BLOB GENERATED ALWAYS AS (zeroblob({size})) VIRTUAL)",
    "CREATE TABLE messages(id INTEGER PRIMARY KEY, topic_id INTEGER, timestamp INTEGER, kept BLOB, "
    "data BLOB GENERATED ALWAYS AS (replace(hex(zeroblob({root})), '0', hex(zeroblob(30)))) VIRTUAL)",
)


@kind
def database_that_makes_up_its_messages(folder, rng):
    path = folder / "a.db3"
    with sqlite3.connect(path) as database:
        database.execute(
            "CREATE TABLE topics(id INTEGER PRIMARY KEY, name TEXT, type TEXT, serialization_format TEXT, "
            "offered_qos_profiles TEXT)"
        )
        database.execute("INSERT INTO topics VALUES (1, '/odom', ?, 'cdr', ?)", (ODOMETRY, qos(rng)))
        size = large(rng, 6.0, 8.9)
        database.execute(DATABASES[int(rng.integers(len(DATABASES)))].format(size=size, root=size // 100))
        try:
            database.executemany(
                "INSERT INTO messages(topic_id, timestamp, kept) VALUES (1, ?, '')", [(k,) for k in range(1000)]
            )
        except sqlite3.Error:
            database.execute("CREATE TABLE IF NOT EXISTS other(messages)")  # a view takes none
    database.close()
    return partial(read, path)


@kind
def database_with_recursive_tables(folder, rng):
    """A view beside the tables, which rosbags asks by name, and messages of different blobs."""
    folder_of = write_bag(folder / "bag", rows())
    path = the_file(folder_of)
    with sqlite3.connect(path) as database:
        database.execute("UPDATE messages SET data = zeroblob(?) WHERE id < 9", (large(rng, 5.0, 8.3),))
    database.close()
    return partial(read, path)


@kind
def damaged_database(folder, rng):
    content = bytearray(the_file(write_bag(folder / "bag", rows())).read_bytes())
    for _ in range(int(rng.integers(1, 30))):
        at = int(rng.integers(16, len(content) - 4))
        content[at : at + 4] = rng.bytes(4) if rng.random() < 0.5 else struct.pack(">I", int(rng.integers(1, 12)))
    return partial(read, written(folder / "a.db3", bytes(content)))


def qos(rng):
    return "" if rng.random() < 0.7 else [aliases(rng), nested(rng)][int(rng.integers(2))]


@kind
def bag_with_a_bomb_for_metadata(folder, rng):
    bag = write_bag(folder / "bag", rows())
    about = (bag / "metadata.yaml").read_text()
    more = [
        aliases(rng),
        "x: " + nested(rng),
        "x: '" + "y" * large(rng, 5.0, 7.0) + "'",
        "".join(f"k{k}: [1, 2]\n" for k in range(large(rng, 3.0, 5.3))),
    ]
    (bag / "metadata.yaml").write_text(about + "\n" + more[int(rng.integers(4))] + "\n")
    return partial(read, bag)


@kind
def bag_whose_file_unpacks_to_gigabytes(folder, rng):
    bag = write_bag(folder / "bag", rows())
    from rosbags.rosbag2.storage_mcap import zstd

    compressor, content = zstd.ZstdCompressor(), the_file(bag).read_bytes()
    parts = [compressor.compress(content)] + [compressor.compress(bytes(2**24)) for _ in range(large(rng, 8.0, 9.9) >> 24)]
    (bag / "bag.db3.zstd").write_bytes(b"".join([*parts, compressor.flush()]))
    the_file(bag).unlink()
    about = (bag / "metadata.yaml").read_text().replace("bag.db3", "bag.db3.zstd")
    about = about.replace("compression_mode: ''", "compression_mode: FILE").replace(
        "compression_format: ''", "compression_format: zstd"
    )
    (bag / "metadata.yaml").write_text(about)
    return partial(read, bag)


def field(name, value):
    return struct.pack("<I", len(name) + 1 + len(value)) + name + b"=" + value


def record_1(fields, data):
    head = b"".join(field(name, value) for name, value in fields.items())
    return struct.pack("<I", len(head)) + head + struct.pack("<I", len(data)) + data


@kind
def bag_of_ros_1_with_a_bomb(folder, rng):
    size = large(rng, 7.0, 9.3)
    packed = rng.choice([b"bz2", b"lz4"])
    data = bz2.compress(bytes(min(size, 10**8))) * max(1, size // 10**8) if packed == b"bz2" else lz4.compress(bytes(size // 2))
    start = b"#ROSBAG V2.0\n"
    chunk = record_1({b"op": b"\x05", b"compression": bytes(packed), b"size": struct.pack("<I", size)}, data)
    index = record_1(
        {b"op": b"\x04", b"ver": struct.pack("<I", 1), b"conn": bytes(4), b"count": struct.pack("<I", 1)},
        struct.pack("<III", 5, 0, 0),
    )
    about = {b"op": b"\x03", b"conn_count": struct.pack("<I", 1), b"chunk_count": struct.pack("<I", 1)}
    head = record_1(about | {b"index_pos": bytes(8)}, b"")
    at = len(start) + len(head) + len(chunk) + len(index)
    head = record_1(about | {b"index_pos": struct.pack("<Q", at)}, b"")
    connection = (
        field(b"topic", b"/odom") + field(b"type", b"nav_msgs/Odometry") + field(b"md5sum", b"f43a8e1b362b75baa741461b46adc7e0")
    )
    connection += field(b"message_definition", b"uint8[] data\n")
    end = record_1({b"op": b"\x07", b"conn": bytes(4), b"topic": b"/odom"}, connection)
    end += record_1(
        {
            b"op": b"\x06",
            b"ver": struct.pack("<I", 1),
            b"chunk_pos": struct.pack("<Q", len(start) + len(head)),
            b"start_time": bytes(8),
            b"end_time": struct.pack("<II", 9, 0),
            b"count": struct.pack("<I", 1),
        },
        bytes(4) + struct.pack("<I", 1),
    )
    return partial(read, written(folder / "a.bag", start + head + chunk + index + end))


# Arrays and tables


def npy(shape, kind_="<f8"):
    buffer = io.BytesIO()
    np.lib.format.write_array_header_1_0(buffer, {"descr": kind_, "fortran_order": False, "shape": shape})
    return buffer.getvalue()


@kind
def npz_of_zeros(folder, rng):
    size, path = large(rng, 7.0, 9.8), folder / "a.npz"
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        for name in rng.choice(["time", "v", "omega", "odometry", "ranges_cm", "x"], 3, replace=False):
            with archive.open(f"{name}.npy", "w", force_zip64=True) as part:
                part.write(npy((size // 8,)))
                for _ in range(size >> 24):
                    part.write(bytes(2**24))
                part.write(bytes(size % 2**24))
    return partial(read, path)


@kind
def npz_that_lies_about_shapes(folder, rng):
    path = folder / "a.npz"
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        for name in ("time", "v", "omega"):
            shape = tuple(large(rng, 2.0, 12.0) for _ in range(int(rng.integers(1, 4))))
            archive.writestr(f"{name}.npy", npy(shape, str(rng.choice(["<f8", "<U100000", "|b1", "<i2"]))) + bytes(10**5))
    return partial(read, path)


@kind
def npz_of_many_parts(folder, rng):
    path = folder / "a.npz"
    with zipfile.ZipFile(path, "w") as archive:
        for k in range(large(rng, 2.0, 4.7)):
            archive.writestr(f"a{k}.npy", npy((0,)))
    return partial(read, path)


@kind
def npz_with_a_huge_header(folder, rng):
    path, size = folder / "a.npz", large(rng, 5.0, 8.0)
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        head = ("{'descr': '<f8', 'fortran_order': False, 'shape': (" + "1, " * (size // 3) + ")}").encode()
        archive.writestr("time.npy", b"\x93NUMPY\x02\x00" + struct.pack("<I", len(head)) + head)
    return partial(read, path)


@kind
def table_of_many_columns(folder, rng):
    count, lines = large(rng, 4.0, 6.0), int(rng.integers(1, 9))
    names = ["t", "v", "omega", "x", "y", "yaw", *(f"c{k}" for k in range(count))]
    content = ",".join(names) + "\n" + "".join(",".join(["1"] * len(names)) + "\n" for _ in range(lines))
    return partial(read, written(folder / "a.csv", content))


@kind
def table_of_many_rows(folder, rng):
    row = str(rng.choice(["1,2,3,4,5,6\n", "\n", ",,,,,\n", '"\n', "1;2\n", "#\n"]))
    content = "t,v,omega,x,y,yaw\n" + row * (large(rng, 6.0, 7.6) // len(row))
    return partial(read, written(folder / "a.csv", content))


@kind
def table_of_repeated_columns(folder, rng):
    content = ",".join(["a"] * large(rng, 4.0, 6.3)) + "\n1,2\n"
    return partial(read, written(folder / "a.csv", content))


@kind
def table_with_long_cells(folder, rng):
    content = "t,v,omega,x,y,yaw\n" + ",".join(["9" * large(rng, 5.0, 6.8)] * 6) + "\n"
    return partial(read, written(folder / "a.csv", content))


@kind
def carmen_with_many_beams(folder, rng):
    beams = large(rng, 4.0, 6.7)
    line = f"FLASER {beams} " + "1 " * beams + "0 0 0 0 0 0 1 host 1\n"
    return partial(read, written(folder / "a.log", line * max(1, int(2e7 / len(line)))))


@kind
def carmen_with_many_lines(folder, rng):
    line = str(
        rng.choice(["ODOM 0 0 0 0 0 0 1 h 1\n", "FLASER 1 1 0 0 0 0 0 0 1 h 1\n", "ODOM\n", "TRUEPOS 1 1 1 1 1 1 1 h 1\n"])
    )
    return partial(read, written(folder / "a.log", "# CARMEN\n" + line * (large(rng, 5.5, 7.0) // len(line))))


@kind
def mrclam_with_many_numbers(folder, rng):
    content = "1 2 3\n" * 3 + "1 " * large(rng, 5.0, 7.3) + "\n" + "1 2 3\n" * large(rng, 3.0, 6.0)
    return partial(read, written(folder / "Robot1_Odometry.dat", content))


@kind
def legs_of_a_tape(folder, rng):
    content = str(
        rng.choice(
            [
                "start,end,distance\n" + "0,1,2\n" * large(rng, 4.0, 6.0),
                "start," * large(rng, 4.0, 6.0),
                'start\n"' + "x" * large(rng, 4.0, 7.0),
            ]
        )
    )
    path = written(folder / "legs.csv", content)
    log = written(folder / "a.csv", "t,v,omega,x,y,yaw\n" + "".join(f"{k},0.1,0,{k * 0.1},0,0\n" for k in range(40)))
    return lambda: read_legs(path, read(log), read)


# No files


@kind
def recording_that_is_no_file(folder, rng):
    suffix = str(rng.choice([".csv", ".npz", ".log", ".mcap", ".db3", ".bag"]))
    return partial(read, put(folder / f"a{suffix}", no_file(rng)))


@kind
def part_of_a_bag_that_is_no_file(folder, rng):
    bag = write_bag(folder / "bag", rows())
    part = bag / "metadata.yaml" if rng.random() < 0.5 else the_file(bag)
    part.unlink()
    put(part, no_file(rng))
    return partial(read, bag)


@kind
def random_bytes_behind_a_magic(folder, rng):
    magics = {
        ".mcap": b"\x89MCAP0\r\n",
        ".db3": b"SQLite format 3\0",
        ".bag": b"#ROSBAG V2.0\n",
        ".npz": b"PK\x03\x04",
        ".csv": b"t,v,omega,x,y\n",
    }
    suffix = str(rng.choice(list(magics)))
    return partial(read, written(folder / f"a{suffix}", magics[suffix] + rng.bytes(large(rng, 1.0, 6.0))))
