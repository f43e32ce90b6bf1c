"""Hostile files of all kinds that a user may be handed, but recordings: each small beside what it asks for, or no file at all.

``KINDS`` has a function for each kind: it writes a file into a folder, by a random generator, and returns what reads the file.
"""

import os
import socket
import struct
import zipfile
import zlib
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image

from turtlebot_gym import Noise, read_parameters
from turtlebot_gym.files import load
from turtlebot_gym.rooms.worlds import find_world
from turtlebot_gym_agents.policies.bundle import BundlePolicy
from turtlebot_gym_agents.training.files import load_model
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


def aliases(rng, depth=None):
    depth = depth or int(rng.integers(6, 40))
    width = int(rng.integers(2, 12))
    lines = ["a0: &a0 [x, x]"] + [f"a{k}: &a{k} [{', '.join([f'*a{k - 1}'] * width)}]" for k in range(1, depth)]
    return "\n".join(lines) + "\n"


def nested(rng, opening="[", closing="]"):
    depth = large(rng, 2.0, 5.5)
    return opening * depth + closing * depth


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
        b"P2\n5000 5000\n255\n" + b"1 " * (size // 2),
        b"P5\n#" + b"x" * size + b"\n10 10\n255\n" + bytes(100),
        b"P5\n%d %d\n255\n" % (size, size),
        b"P5\n5474 4795\n255\n" + b"\xfe" * (5474 * 4795),
        b"P6\n5000 5000\n255\n" + bytes(75_000_000),
    )
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
    return partial(load_model, path, "ppo", allow_pickle=True)


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
    ".onnx": BundlePolicy,
    ".zip": lambda path: load_model(path, "ppo", allow_pickle=True),
}


def no_file(rng):
    return str(rng.choice(NO_FILES))


@kind
def what_is_no_file(folder, rng):
    suffix = str(rng.choice(list(BY_SUFFIX)))
    return partial(BY_SUFFIX[suffix], put(folder / f"a{suffix}", no_file(rng)))


@kind
def a_part_that_is_no_file(folder, rng):
    what = no_file(rng)
    put(folder / "map.pgm", what)
    return a_map(folder, "map.pgm" if rng.random() < 0.5 else what)


@kind
def random_bytes_behind_a_magic(folder, rng):
    magics = {".zip": b"PK\x05\x06", ".onnx": b"\x08\x07"}
    suffix = str(rng.choice(list(magics)))
    return partial(BY_SUFFIX[suffix], written(folder / f"a{suffix}", magics[suffix] + rng.bytes(large(rng, 1.0, 6.0))))
