"""Noise models and robots in files: what is written is read again, everywhere, and what is wrong is one line."""

import math
import re
import time
from dataclasses import asdict

import gymnasium as gym
import numpy as np
import pytest

from turtlebot_gym.files import load, read_parameters, write_parameters
from turtlebot_gym.parameters import FixNoise, Noise, OdometryNoise, ProcessNoise
from turtlebot_gym.presets import FIXES, NOISES
from turtlebot_gym.robots import ROBOTS, Robot
from turtlebot_gym.systems import make_parameters
from turtlebot_gym.systems.imu import IMUS, ImuNoise

NAV = "turtlebot_gym/TurtleBotNav-v0"
PRESETS = {"noise": (Noise, NOISES), "robot": (Robot, ROBOTS), "fix": (FixNoise, FIXES), "imu": (ImuNoise, IMUS)}


@pytest.mark.parametrize("option", PRESETS)
def test_a_preset_is_read_as_it_was_written(tmp_path, option):
    kind, presets = PRESETS[option]
    for name, preset in presets.items():
        path = tmp_path / "lab" / f"{name}.yaml"
        write_parameters(preset, path, comment="Two lines\nof comment")
        assert re.match(r"# Two lines\n# of comment\n\{?\w+:", path.read_text())
        assert read_parameters(kind, path) == preset
        assert all(getattr(make_parameters(**{option: given}), option) == preset for given in (path, str(path)))


def test_what_is_left_out_is_at_its_default(tmp_path):
    path = tmp_path / "noise.yaml"
    path.write_text("odometry: {R: [1e-3, 0.002, 3], wheel: false}\nprocess: {alpha1: 1e-2}\n")
    assert read_parameters(Noise, path) == Noise(
        process=ProcessNoise(alpha1=0.01), odometry=OdometryNoise(R=(0.001, 0.002, 3.0))
    )
    path.write_text("max_linear: 0.3\nmax_angular: 1\nmax_wheel: .inf\nreverse: false\n")
    assert read_parameters(Robot, path) == Robot(max_linear=0.3, max_angular=1.0, max_wheel=math.inf, reverse=False)


TRIED = [("noise", "documented", {}), ("robot", "waffle", {}), ("fix", "localization", {"noise": "wheel"})]


@pytest.mark.parametrize(("option", "name", "others"), [*TRIED, ("imu", "calibrated", {"filter": "gyro"})])
def test_an_environment_takes_a_preset_by_name_file_value_and_mapping(tmp_path, option, name, others):
    preset = PRESETS[option][1][name]
    write_parameters(preset, tmp_path / "mine.yaml")
    drives = []
    for given in (name, str(tmp_path / "mine.yaml"), preset, asdict(preset)):
        env = gym.make(NAV, **others, **{option: given}).unwrapped
        env.reset(seed=3)
        drives.append((env.parameters, [env.step(np.array([1.0, 0.2], np.float32))[0].tolist() for _ in range(30)]))
        env.close()
    assert all(drive == drives[0] for drive in drives)


@pytest.mark.parametrize(
    ("kind", "text", "message"),
    [
        (Robot, None, "There is no robot file '.*bad.yaml', or it cannot be read: No such file"),
        (Noise, "", r"bad.yaml: noise must be a Noise or a mapping of its fields \(process, odometry\), got None"),
        (Noise, "a: [", "bad.yaml is not YAML: while parsing"),
        (Noise, "\x00", "bad.yaml is not YAML: "),
        (
            Noise,
            "process: {alpha9: 1, alpha8: 2}",
            "bad.yaml: Noise.process: ProcessNoise has no alpha9, alpha8; it has ",
        ),
        (Noise, "process: {alpha1: -1}", "bad.yaml: ProcessNoise.alpha1 must be a number from 0 .*, got -1"),
        (Robot, "max_linear: 0.2", "bad.yaml: robot: Robot needs max_angular"),
    ],
)
def test_what_is_wrong_with_a_file_is_one_line(tmp_path, kind, text, message):
    path = tmp_path / "bad.yaml"
    if text is not None:
        path.write_text(text)
    with pytest.raises(ValueError, match=message) as caught:
        read_parameters(kind, path)
    assert "\n" not in str(caught.value)


def test_numbers_are_read_as_one_writes_them(tmp_path):
    (tmp_path / "a.yaml").write_text("[1e-3, 1e6, -2.5e3, .5E1, 1.5, 3, 0x10, 1.0, .inf, e3, '1e3', 1e400]")
    content = load(tmp_path / "a.yaml")
    assert content == [0.001, 1_000_000, -2500, 5, 1.5, 3, 16, 1.0, math.inf, "e3", "1e3", math.inf]
    assert [type(number) for number in content[:5]] == [float, int, int, int, float]
    (tmp_path / "a.json").write_text('{"a": [1e6, null, "x"]}')
    assert load(tmp_path / "a.json") == {"a": [1e6, None, "x"]}


def bomb(alias):
    levels = ["a0: &a0 [x, x]" if alias != "<<" else "a0: &a0 {x: 1, y: 2}"]
    for k in range(12):
        parts = ", ".join([f"*a{k}"] * 9)
        levels.append(f"a{k + 1}: &a{k + 1} [{parts}]" if alias != "<<" else f"a{k + 1}: &a{k + 1} {{<<: [{parts}], k{k}: 1}}")
    return "\n".join(levels)


DEEP, NO_TEXT = "nested deeper than 100 levels", "it is no text: invalid start byte at byte 0"


@pytest.mark.parametrize(
    ("name", "content", "reason"),
    [
        *(
            ("a.json", content, DEEP)
            for content in (b"[" * 100_000, b"[" * 101 + b"]" * 101, b'{"a":' * 101 + b"1" + b"}" * 101)
        ),
        ("a.json", b"{", "Expecting property name"),
        *((name, b"\xff", NO_TEXT) for name in ("a.json", "a.yaml")),
        *(("a.yaml", content, DEEP) for content in (b"[" * 100_000, b"- " * 101 + b"1")),
        *(("a.yaml", text.encode(), "more than 100,000 values") for text in (bomb("*"), bomb("<<"), "&a [*a]")),
        ("a.yaml", b"a: [", "while parsing a flow"),
        ("a.yaml", b"!!python/object/apply:os.system [ls]", "could not determine a constructor"),
        ("a.yaml", b"!!timestamp 2001-99-99", "month must be in 1..12"),
        ("a.yaml", b"!!int ''", "string index out of range"),
    ],
    ids=lambda value: value[:20] if isinstance(value, str) else None,
)
def test_a_file_that_cannot_be_read_is_refused_within_a_second(tmp_path, name, content, reason):
    (tmp_path / name).write_bytes(content)
    start = time.process_time()
    with pytest.raises(ValueError, match=rf"^{re.escape(str(tmp_path / name))} is not (JSON|YAML): .*{reason}") as caught:
        load(tmp_path / name)
    assert "\n" not in str(caught.value)
    assert time.process_time() - start < 1.0


def test_what_is_as_deep_and_as_large_as_allowed_is_read_and_a_missing_file_is_an_error_of_the_system(tmp_path):
    with pytest.raises(FileNotFoundError):
        load(tmp_path / "a.json")
    (tmp_path / "a.json").write_text("[" * 100 + "]" * 100)
    (tmp_path / "a.yaml").write_text("- " * 99 + "1")
    (tmp_path / "b.yaml").write_text("a: &a {x: 1}\nb: [*a, *a]\nc: {<<: *a, y: 2}")
    assert load(tmp_path / "a.json")
    assert load(tmp_path / "a.yaml")
    assert load(tmp_path / "b.yaml") == {"a": {"x": 1}, "b": [{"x": 1}, {"x": 1}], "c": {"x": 1, "y": 2}}
