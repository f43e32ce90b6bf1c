"""Hostile files of all kinds that a user may be handed: each small beside what it asks for, or no file at all.

``KINDS`` has a function for each kind: it writes a file into a folder, by a random generator, and returns what reads the file.
"""

import bz2
import hashlib
import io
import itertools
import math
import os
import socket
import sqlite3
import struct
import zipfile
import zlib
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import onnx
from bundles import rewritten, small_bundle
from lz4 import frame as lz4
from onnx import helper, numpy_helper
from PIL import Image
from rosbag_messages import ODOMETRY, TF, Plugin, header, make, odometry, rosbag2, transform, write_bag

from turtlebot_gym import Noise, read_parameters
from turtlebot_gym.calibration.tape import read_legs
from turtlebot_gym.drives import read
from turtlebot_gym.files import load
from turtlebot_gym.rooms.worlds import find_world
from turtlebot_gym_agents.policies.bundle import BundlePolicy
from turtlebot_gym_agents.training.export import load_model
from turtlebot_gym_agents.training.hyperparameters import load as load_hyperparameters

Rng = np.random.Generator
Reader = Callable[[], Any]
KINDS: dict[str, Callable[[Path, Rng], Reader]] = {}
"""Kinds of hostile files by name."""
MAP = "image: {image}\nresolution: 0.05\norigin: [0, 0, 0]\nnegate: 0\noccupied_thresh: 0.65\nfree_thresh: 0.196\n"


def kind(make_file):
    KINDS[make_file.__name__] = make_file
    return make_file


def large(rng, low=6.0, high=9.7):
    """Return a whole number whose logarithm is uniform."""
    return int(10 ** rng.uniform(low, high))


def written(path, content):
    path.write_bytes(content if isinstance(content, bytes) else content.encode())
    return path


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
    writer = rosbag2.Writer(folder, version=9, storage_plugin=Plugin.MCAP)
    writer.set_compression(rosbag2.CompressionMode.STORAGE, rosbag2.CompressionFormat.ZSTD)
    from rosbag_messages import TYPES

    with writer:
        opened = {}
        for topic, type_, received, message in messages:
            if topic not in opened:
                opened[topic] = writer.add_connection(topic, type_, typestore=TYPES)
            writer.write(opened[topic], round(received * 1e9), TYPES.serialize_cdr(message, type_))
    return folder


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


def aliases(rng, depth=None):
    depth = depth or int(rng.integers(6, 40))
    width = int(rng.integers(2, 12))
    lines = ["a0: &a0 [x, x]"] + [f"a{k}: &a{k} [{', '.join([f'*a{k - 1}'] * width)}]" for k in range(1, depth)]
    return "\n".join(lines) + "\n"


def nested(rng, opening="[", closing="]"):
    depth = large(rng, 2.0, 5.5)
    return opening * depth + closing * depth


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
        {b"op": b"\x06", b"ver": struct.pack("<I", 1), b"chunk_pos": struct.pack("<Q", len(start) + len(head)),
         b"start_time": bytes(8), b"end_time": struct.pack("<II", 9, 0), b"count": struct.pack("<I", 1)},
        bytes(4) + struct.pack("<I", 1),
    )  # fmt: skip
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


# Text


@kind
def yaml_of_aliases(folder, rng):
    path = written(folder / "a.yaml", aliases(rng))
    return partial(read_parameters, Noise, path)


@kind
def yaml_that_is_deep(folder, rng):
    path = written(
        folder / "a.yaml", [nested(rng), nested(rng, "{a: ", "}"), "- " * large(rng, 2.0, 5.0) + "a"][int(rng.integers(3))]
    )
    return partial(find_world, str(path))


@kind
def yaml_that_is_long(folder, rng):
    size = large(rng, 5.0, 7.7)
    part = str(rng.choice(["[], ", "1, ", "a b ", "? , ", "&a 1, ", "!!str a, ", "'', ", "1:1:1, "]))
    path = written(folder / "a.yaml", "[" + part * (size // len(part)) + "]")
    return partial(load_hyperparameters, "ppo", "a", path)


@kind
def yaml_of_numbers_in_sixties(folder, rng):
    path = written(folder / "a.yaml", "a: 1" + ":1" * large(rng, 4.0, 6.5) + "\n")
    return partial(read_parameters, Noise, path)


@kind
def yaml_of_keys_with_one_hash(folder, rng):
    keys = ", ".join(f"{k * (2**61 - 1)}: 1" for k in range(1, large(rng, 3.0, 5.0)))
    return partial(load, written(folder / "a.yaml", "{" + keys + "}"))


@kind
def json_that_is_deep_or_long(folder, rng):
    size = large(rng, 5.0, 7.7)
    texts = (
        nested(rng),
        nested(rng, '{"a":', "}"),
        "[" + "[]," * (size // 3) + "[]]",
        "[" + "1," * (size // 2) + "1]",
        "9" * size,
        '"' + "\\u00e9" * (size // 6) + '"',
    )
    return partial(load, written(folder / "a.json", texts[int(rng.integers(len(texts)))]))


# Worlds and maps


@kind
def world_with_entities(folder, rng):
    depth, width = int(rng.integers(3, 30)), int(rng.integers(5, 20))
    entities = ['<!ENTITY a0 "xxxxxxxxxxxxxxxxxxxx">'] + [f'<!ENTITY a{k} "{f"&a{k - 1};" * width}">' for k in range(1, depth)]
    content = f"<?xml version='1.0'?><!DOCTYPE sdf [{''.join(entities)}]><sdf><world>&a{depth - 1};</world></sdf>"
    return partial(find_world, str(written(folder / "a.world", content)))


@kind
def world_that_is_deep(folder, rng):
    depth = large(rng, 1.5, 5.5)
    tags = [["a"], ["model"], ["model", "link", "collision"]][int(rng.integers(3))]
    static = "<static>1</static><pose>0 0 0 0 0 0</pose>"
    shape = "<geometry><cylinder><radius>1</radius></cylinder></geometry>"
    opening = "".join(
        "".join(f"<{tag}>{static if tag == 'model' else ''}{shape if tag == 'collision' else ''}" for _ in range(depth))
        for tag in tags
    )
    closing = "".join(f"</{tag}>" * depth for tag in reversed(tags))
    return partial(find_world, str(written(folder / "a.sdf", f"<sdf><world>{opening}{closing}</world></sdf>")))


@kind
def world_of_many_elements(folder, rng):
    part = str(
        rng.choice(
            [
                "<a/>",
                "<model/>",
                "<model><static>1</static><link><collision><geometry><cylinder><radius>1</radius></cylinder></geometry></collision></link></model>",
            ]
        )
    )
    content = f"<sdf><world>{part * (large(rng, 5.0, 7.7) // len(part))}</world></sdf>"
    return partial(find_world, str(written(folder / "a.world", content)))


def a_map(folder, image):
    return partial(find_world, str(written(folder / "map.yaml", MAP.format(image=image))))


def png(width, height, content):
    def chunk(name, data):
        return struct.pack(">I", len(data)) + name + data + struct.pack(">I", zlib.crc32(name + data))

    start = chunk(b"IHDR", struct.pack(">IIBBBBB", width, height, 8, 0, 0, 0, 0))
    return b"\x89PNG\r\n\x1a\n" + start + chunk(b"IDAT", content) + chunk(b"IEND", b"")


def zeros_by_zlib(size):
    compressor = zlib.compressobj(9)
    parts = [compressor.compress(bytes(2**24)) for _ in range(size >> 24)]
    return b"".join([*parts, compressor.compress(bytes(size % 2**24)), compressor.flush()])


@kind
def png_of_many_pixels(folder, rng):
    width, height = large(rng, 3.0, 5.0), large(rng, 3.0, 5.0)
    written(folder / "map.png", png(width, height, zeros_by_zlib(min(width * height + height, 10**9))))
    return a_map(folder, "map.png")


@kind
def png_just_within_the_limit(folder, rng):
    written(folder / "map.png", png(6000, 6000, zeros_by_zlib(6000 * 6001)))
    return a_map(folder, "map.png")


@kind
def pgm_that_is_odd(folder, rng):
    size = large(rng, 5.0, 7.7)
    texts = (
        b"P2\n5000 5000\n255\n" + b"1 " * (size // 2), b"P5\n#" + b"x" * size + b"\n10 10\n255\n" + bytes(100),
        b"P5\n%d %d\n255\n" % (size, size), b"P5\n5474 4795\n255\n" + b"\xfe" * (5474 * 4795),
        b"P6\n5000 5000\n255\n" + bytes(75_000_000),
    )  # fmt: skip
    written(folder / "map.pgm", texts[int(rng.integers(len(texts)))])
    return a_map(folder, "map.pgm")


@kind
def image_of_another_kind(folder, rng):
    side = int(rng.integers(100, 9000))
    name = str(rng.choice(["gif", "bmp", "tiff", "jpg", "webp", "eps"]))
    image = Image.new("L", (side, side if name != "webp" else 100), 254)
    image.save(
        folder / f"map.{name}",
        **({"progressive": True} if name == "jpg" else {"compression": "tiff_deflate"} if name == "tiff" else {}),
    )
    if rng.random() < 0.5:
        content = bytearray((folder / f"map.{name}").read_bytes())
        for _ in range(5):
            content[int(rng.integers(len(content)))] = int(rng.integers(256))
        written(folder / f"map.{name}", bytes(content))
    return a_map(folder, f"map.{name}")


# Policies


def model_with(nodes, numbers=()):
    def change(model):
        del model.graph.node[1:]
        model.graph.node.extend(nodes)
        model.graph.initializer.extend(numpy_helper.from_array(np.asarray(value), name) for name, value in numbers)

    return change


def onnx_file(folder, change):
    return partial(BundlePolicy, rewritten(small_bundle(folder), change=change))


def doubled(before, count, axis):
    nodes = []
    for k in range(count):
        nodes.append(helper.make_node("Concat", [before, before], [f"twice{k}"], axis=axis))
        before = f"twice{k}"
    return nodes, before


CUT = [("first", [0]), ("end", [2]), ("axis", [1])]


@kind
def onnx_of_concats(folder, rng):
    nodes, last = doubled("W" if rng.random() < 0.3 else "product", int(rng.integers(18, 40)), int(rng.integers(2)))
    nodes += [helper.make_node("Slice", [last, "first", "end", "axis"], ["cut"]), helper.make_node("Tanh", ["cut"], ["action"])]
    return onnx_file(folder, model_with(nodes, CUT))


@kind
def onnx_with_a_wide_window(folder, rng):
    size = large(rng, 7.0, 9.3)
    name = str(rng.choice(["Conv", "MaxPool", "AveragePool"]))
    kernel = int(rng.choice([3, size]))
    options: dict[str, Any] = {"kernel_shape": [kernel], "pads": [size - 1, size - 1]}
    inputs = ["row", "kernel"] if name == "Conv" else ["row"]
    if kernel == 3 and name != "AveragePool":
        options["dilations"] = [int(rng.choice([1, size // 2]))]
    nodes = [
        helper.make_node("Unsqueeze", ["product", "axis"], ["row"]),
        helper.make_node(name, inputs, ["wide"], **options),
        helper.make_node("GlobalMaxPool", ["wide"], ["one"]),
        helper.make_node("Concat", ["one", "one"], ["two"], axis=2),
        helper.make_node("Squeeze", ["two", "axis"], ["action"]),
    ]
    return onnx_file(folder, model_with(nodes, [("axis", [1]), ("kernel", np.ones((1, 1, 3), np.float32))]))


@kind
def onnx_of_outer_products(folder, rng):
    nodes, last = [], "product"
    for k in range(int(rng.integers(2, 8))):
        nodes.append(helper.make_node("Unsqueeze", [last, "axis"], [f"wide{k}"]))
        nodes.append(helper.make_node("Unsqueeze", [last, "back"], [f"tall{k}"]))
        nodes.append(helper.make_node("Add", [f"wide{k}", f"tall{k}"], [f"all{k}"]))
        nodes.append(helper.make_node("Reshape", [f"all{k}", "rows"], [f"flat{k}"]))
        last = f"flat{k}"
    nodes += [helper.make_node("Slice", [last, "first", "end", "axis"], ["action"])]
    return onnx_file(folder, model_with(nodes, [*CUT, ("back", [2]), ("rows", [0, -1])]))


@kind
def onnx_that_multiplies_matrices(folder, rng):
    side = int(rng.integers(100, 1200))
    nodes = [helper.make_node("MatMul", ["M", "M"], ["m0"])]
    nodes += [helper.make_node("MatMul", [f"m{k}", "M"], [f"m{k + 1}"]) for k in range(int(rng.integers(50, 2000)))]
    nodes += [
        helper.make_node("ReduceMax", [nodes[-1].output[0]], ["most"], keepdims=0),
        helper.make_node("Mul", ["product", "most"], ["much"]),
        helper.make_node("Tanh", ["much"], ["action"]),
    ]
    return onnx_file(folder, model_with(nodes, [("M", np.zeros((side, side), np.float32))]))


@kind
def onnx_of_many_nodes(folder, rng):
    count = large(rng, 3.0, 5.3)
    names = ["product", *(f"n{k}" for k in range(count)), "action"]
    return onnx_file(folder, model_with([helper.make_node("Tanh", [a], [b]) for a, b in itertools.pairwise(names)]))


@kind
def onnx_of_many_fields(folder, rng):
    """A file in the wire format of ONNX of tiny fields, with its own hash."""
    blank = (
        b'"sha256": "'
        + b"0" * 64
        + b'"'
        + bytes(rng.choice([b"\x08\x01", b"\x3a\x00", b"\x3a\x02\x0a\x00"])) * (large(rng, 5.0, 7.6) // 3)
    )
    blank = b"\xfa\x06" + bytes([11 + 64 + 1]) + blank  # field 111: a text with the hash
    return partial(
        BundlePolicy, written(folder / "a.onnx", blank.replace(b"0" * 64, hashlib.sha256(blank).hexdigest().encode(), 1))
    )


@kind
def onnx_that_lies_about_tensors(folder, rng):
    def change(model):
        tensor = model.graph.initializer[0]
        tensor.dims[:] = [large(rng, 4.0, 10.0) for _ in range(int(rng.integers(1, 4)))]
        if rng.random() < 0.5:
            tensor.ClearField("raw_data")
        if rng.random() < 0.3:
            values = onnx.helper.make_tensor("values", 1, [1], [1.0])
            indices = onnx.helper.make_tensor("indices", 7, [1], [5])
            model.graph.sparse_initializer.append(onnx.helper.make_sparse_tensor(values, indices, [large(rng, 8.0, 10.0)]))

    return onnx_file(folder, change)


@kind
def zip_of_a_model_that_is_a_bomb(folder, rng):
    path, size = folder / "model.zip", large(rng, 7.0, 9.7)
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        with archive.open("data", "w", force_zip64=True) as part:
            unit = bytes(rng.choice([b"[],", b" ", b'{"":1},', b"1,"]))
            part.write(b"[")
            for _ in range(size // 2**20):
                part.write((unit * 2**20)[: 2**20 // len(unit) * len(unit)])
            part.write(b"1]")
        archive.writestr("policy.pth", bytes(large(rng, 5.0, 8.0)))
    return partial(load_model, path, allow_pickle=True)


# What is no file


def put(path, what):
    """Make something that is no file at a path, and return the path of it."""
    if what == "pipe":
        os.mkfifo(path)
    elif what == "socket":
        with socket.socket(socket.AF_UNIX) as server:
            server.bind(str(path))
    elif what == "folder":
        path.mkdir()
    elif what == "link to itself":
        path.symlink_to(path)
    else:
        path.symlink_to(what)
    return path


NO_FILES = (
    "pipe",
    "socket",
    "folder",
    "link to itself",
    "/dev/zero",
    "/dev/random",
    "/dev/stdin",
    "/proc/kcore",
    "/dev/tty",
    "/proc/kmsg",
)
BY_SUFFIX: dict[str, Callable[[Path], Any]] = {
    ".yaml": lambda path: find_world(str(path)),
    ".yml": lambda path: read_parameters(Noise, path),
    ".json": load,
    ".world": lambda path: find_world(str(path)),
    ".csv": read,
    ".npz": read,
    ".log": read,
    ".mcap": read,
    ".db3": read,
    ".bag": read,
    ".onnx": BundlePolicy,
    ".zip": lambda path: load_model(path, allow_pickle=True),
}


@kind
def what_is_no_file(folder, rng):
    suffix = str(rng.choice(list(BY_SUFFIX)))
    return partial(BY_SUFFIX[suffix], put(folder / f"a{suffix}", str(rng.choice(NO_FILES))))


@kind
def a_part_that_is_no_file(folder, rng):
    what = str(rng.choice(NO_FILES))
    if rng.random() < 0.4:
        put(folder / "map.pgm", what)
        return a_map(folder, "map.pgm" if rng.random() < 0.5 else what)
    bag = write_bag(folder / "bag", rows())
    part = bag / "metadata.yaml" if rng.random() < 0.5 else the_file(bag)
    part.unlink()
    put(part, what)
    return partial(read, bag)


@kind
def random_bytes_behind_a_magic(folder, rng):
    magics = {
        ".mcap": b"\x89MCAP0\r\n",
        ".db3": b"SQLite format 3\0",
        ".bag": b"#ROSBAG V2.0\n",
        ".npz": b"PK\x03\x04",
        ".zip": b"PK\x05\x06",
        ".onnx": b"\x08\x07",
        ".csv": b"t,v,omega,x,y\n",
    }
    suffix = str(rng.choice(list(magics)))
    return partial(BY_SUFFIX[suffix], written(folder / f"a{suffix}", magics[suffix] + rng.bytes(large(rng, 1.0, 6.0))))
