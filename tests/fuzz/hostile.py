"""Hostile files of all kinds that a user may be handed, but recordings: each small beside what it asks for, or no file at all.

``KINDS`` has a function for each kind: it writes a file into a folder, by a random generator, and returns what reads the file.
"""

import hashlib
import itertools
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
import onnx
from bundles import rewritten, small_bundle
from onnx import helper, numpy_helper
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
    ".onnx": BundlePolicy,
    ".zip": lambda path: load_model(path, allow_pickle=True),
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
