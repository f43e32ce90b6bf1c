"""What a power cut, a lost file or a wrong clock leave of a bag is read, and what is missing is said."""

import re
import shutil
import sqlite3

import numpy as np
import pytest
from drawing import draw
from rosbag_messages import ODOMETRY, POSE, TYPES, Plugin, header, make, odometry, pose, write_bag

from turtlebot_gym_lab.drives import read

pytestmark = pytest.mark.touched("lab", "tests/lab")

START = 1e9
DRAWN = draw(600, dt=0.05, deviations=(0.0, 0.0, 0.0))


def messages(*, late=lambda k: 0.0):
    """Return the messages of a drive; ``late``: by how much the recorder's clock is wrong at each row, s."""
    return [
        message
        for k, time in enumerate(START + DRAWN.time)
        for message in (
            ("/odom", ODOMETRY, time + 0.002 + late(k), odometry(time, DRAWN.odometry[k], DRAWN.twist[k])),
            ("/ground_truth", POSE, time + 0.003, make(POSE, header(time), pose(*DRAWN.truth[k]))),
        )
    ]


def the_file(folder):
    return next(path for path in folder.iterdir() if path.suffix in (".mcap", ".db3"))


def cut(folder, share):
    file = the_file(folder)
    file.write_bytes(file.read_bytes()[: round(share * file.stat().st_size)])
    return folder


def chunked(folder, codec):
    """Write MCAP as its own library does, in chunks."""
    writer = pytest.importorskip("mcap.writer")
    folder.mkdir()
    with open(folder / "bag_0.mcap", "wb") as file:
        out, channels = writer.Writer(file, compression=codec, chunk_size=100_000), {}
        out.start("ros2")
        for topic, kind, received, message in messages():
            if topic not in channels:
                definition = TYPES.generate_msgdef(kind, ros_version=2)[0].encode()
                channels[topic] = out.register_channel(topic, "cdr", out.register_schema(kind, "ros2msg", definition))
            time = round(received * 1e9)
            out.add_message(channels[topic], time, bytes(TYPES.serialize_cdr(message, kind)), time)
        out.finish()
    return folder


@pytest.mark.parametrize("codec", ["", "lz4", "zstd"])
def test_an_mcap_file_without_an_end_is_read_up_to_the_cut(tmp_path, codec):
    writer = pytest.importorskip("mcap.writer")
    kinds = {"": writer.CompressionType.NONE, "lz4": writer.CompressionType.LZ4, "zstd": writer.CompressionType.ZSTD}
    drive = read(cut(chunked(tmp_path / "bag", kinds[codec]), 0.6))
    assert 0.4 * len(DRAWN) < len(drive) < 0.75 * len(DRAWN)
    np.testing.assert_allclose(drive.truth[: len(drive) - 1], DRAWN.truth[: len(drive) - 1], atol=1e-6)
    assert any("has no end, as after a power cut" in remark for remark in drive.remarks)


@pytest.mark.parametrize("share", [0.9, 0.3])
def test_a_database_that_is_cut_is_read_up_to_the_cut(tmp_path, share):
    drive = read(cut(write_bag(tmp_path / "bag", messages()), share))
    assert abs(len(drive) - share * len(DRAWN)) < 0.1 * len(DRAWN)
    assert any("as after a power cut" in remark for remark in drive.remarks)


def test_what_only_the_journal_of_a_database_holds_is_read_and_the_bag_is_left_as_it_is(tmp_path):
    folder = write_bag(tmp_path / "bag", messages())
    database = sqlite3.connect(the_file(folder))
    database.execute("PRAGMA journal_mode=WAL")
    database.execute("PRAGMA wal_autocheckpoint=0")
    rows = database.execute("SELECT * FROM messages WHERE id > 600").fetchall()
    database.execute("DELETE FROM messages WHERE id > 600")
    database.commit()
    database.execute("PRAGMA wal_checkpoint(TRUNCATE)")
    database.executemany("INSERT INTO messages VALUES (?, ?, ?, ?)", rows)
    database.commit()
    shutil.copytree(folder, tmp_path / "cut")
    database.close()
    before = {path.name: path.read_bytes() for path in (tmp_path / "cut").iterdir()}
    drive = read(tmp_path / "cut")
    assert len(drive) == len(DRAWN)
    assert any("the recording was not closed: what its journal holds is read" in remark for remark in drive.remarks)
    assert {path.name: path.read_bytes() for path in (tmp_path / "cut").iterdir()} == before


@pytest.mark.parametrize(
    ("spoil", "rows", "said"),
    [
        (lambda files: None, 600, "metadata.yaml is missing: the files are read without it"),
        (lambda files: files[1].write_bytes(b""), 400, "_1.mcap: the file is empty: the recording was cut off"),
        (
            lambda files: files[1].write_bytes(bytes(range(256)) * 9),
            400,
            "_1.mcap: the bag is damaged .* left out",
        ),
        (lambda files: files[1].unlink(), 400, "the file with number 1 is missing"),
    ],
)
def test_files_without_metadata_are_one_bag_in_the_order_of_their_numbers(tmp_path, spoil, rows, said):
    folder, third = tmp_path / "bag", len(messages()) // 3
    folder.mkdir()
    for k in range(3):
        part = write_bag(tmp_path / f"part{k}", messages()[k * third : (k + 1) * third], plugin=Plugin.MCAP)
        shutil.copy(the_file(part), folder / f"walk_{k}.mcap")
    spoil(sorted(folder.iterdir()))
    drive = read(folder)
    assert len(drive) == rows
    assert any(re.search(said, remark) for remark in drive.remarks)


def test_a_folder_of_several_bags_is_refused(tmp_path):
    for name in ("a_0.db3", "b_0.db3"):
        (tmp_path / name).write_bytes(b"SQLite format 3\0")
    with pytest.raises(ValueError, match=r"several bags, and no metadata\.yaml: give one of its files"):
        read(tmp_path)


@pytest.mark.sample(2)
@pytest.mark.parametrize("by", [2**32 / 1e9, -(2**32) / 1e9, 2.0**32, -START])
@pytest.mark.parametrize("plugin", list(Plugin))
def test_a_few_receive_times_that_rolled_over_count_for_nothing(tmp_path, plugin, by):
    drive = read(write_bag(tmp_path / "bag", messages(late=lambda k: by * (300 <= k < 303)), plugin=plugin))
    np.testing.assert_allclose(drive.time, DRAWN.time, atol=1e-6)
    np.testing.assert_allclose(drive.truth, DRAWN.truth, atol=1e-6)
    (remark,) = drive.remarks
    assert "the recorder's clock is wrong in 3 messages: their stamps count" in remark


def test_a_quaternion_whose_w_was_never_set_is_no_heading(tmp_path):
    said = messages()
    for topic, _, _, message in said:
        if topic == "/odom":
            message.pose.pose.orientation.w = 0.0
    drive = read(write_bag(tmp_path / "bag", said))
    assert np.isnan(drive.odometry[:, 2]).all()
    assert "w is always 0: was it never set?" in drive.remarks[0]
