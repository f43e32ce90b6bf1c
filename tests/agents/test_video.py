"""Videos: they show the episode that an evaluation measures, at the given speed, in colours that do not change."""

import subprocess
import sys

import gymnasium as gym
import numpy as np
import pytest
from PIL import Image, ImageSequence

from turtlebot_gym_agents.commands.cli import main
from turtlebot_gym_agents.commands.video import HOLD, record
from turtlebot_gym_agents.evaluation.evaluate import evaluate
from turtlebot_gym_agents.policies import BearingPolicy

NAV, SQUARE = "turtlebot_gym/TurtleBotNav-v0", "turtlebot_gym/TurtleBotSquare-v0"
WHITE, BLACK, VERMILLION, SKY_BLUE, GREEN = (255, 255, 255), (0, 0, 0), (213, 94, 0), (86, 180, 233), (0, 158, 115)


def drive(seed, policy, **options):
    """Return the environment's own pictures of an episode."""
    env = gym.make(NAV, render_mode="rgb_array", **options)
    observation, _ = env.reset(seed=seed)
    pictures, ended = [env.render()], False
    while not ended:
        observation, _, terminated, truncated, _ = env.step(policy(observation))
        pictures.append(env.render())
        ended = terminated or truncated
    env.close()
    return pictures


def read_gif(path):
    """Return frames (n, height, width, 3) and how long each lasts, s."""
    with Image.open(path) as image:
        frames = [(np.asarray(frame.convert("RGB")), frame.info["duration"]) for frame in ImageSequence.Iterator(image)]
    pictures, durations = zip(*frames, strict=True)
    return np.array(pictures), np.array(durations) / 1000.0


@pytest.mark.parametrize("seed", [2, 31])
def test_it_is_the_first_episode_of_an_evaluation(tmp_path, seed):
    video = record("bearing", tmp_path / "a.gif", seed=seed, speed=40.0, fps=10, width=160, noise="documented")
    evaluation = evaluate("bearing", episodes=1, seed=seed, noise="documented")
    assert video.time == pytest.approx(evaluation.episodes.time[0])
    assert video.success == evaluation.episodes.success[0]
    assert evaluate("bearing", episodes=1, seed=seed + 1, noise="documented").episodes.time[0] != pytest.approx(video.time)


def test_frames_of_a_gif_are_the_environments_pictures(tmp_path):
    record("bearing", tmp_path / "a.gif", seed=2, speed=4.0, fps=20)
    frames, durations = read_gif(tmp_path / "a.gif")
    pictures = drive(2, BearingPolicy())
    shown = pictures[::2]  # 4 times as fast, 20 frames a second: every second step of 0.1 s
    if len(pictures) % 2 == 0:
        shown.append(pictures[-1])  # the end is always shown
    assert frames.shape[0] == len(shown)
    for frame, picture in zip(frames, shown, strict=True):
        error = np.abs(frame.astype(int) - picture).max(-1)
        assert np.mean(error > 16) < 0.01  # smoothed edges
    np.testing.assert_allclose(durations[:-1], 0.05)
    assert HOLD <= durations[-1] <= HOLD + 0.05


def test_colours_are_exact_and_do_not_flicker(tmp_path):
    record("bearing", tmp_path / "a.gif", seed=2)
    frames, _ = read_gif(tmp_path / "a.gif")
    for name, color in (("white", WHITE), ("black", BLACK), ("estimate", VERMILLION), ("odometry", SKY_BLUE), ("green", GREEN)):
        assert (frames == color).all(-1).sum((1, 2)).min() > 5, name
    legend = frames[:, 34:64]
    assert np.ptp(legend, axis=0).max() == 0


@pytest.mark.parametrize(("speed", "fps"), [(1.0, 10), (8.0, 20), (3.0, 25), (0.5, 50)])
def test_a_video_plays_at_the_speed_and_reports_its_steps(tmp_path, speed, fps):
    options, steps = {"seed": 2, "speed": speed, "fps": fps, "width": 160, "robot": "turtlebot4"}, []
    video = record("bearing", tmp_path / "a.gif", progress=lambda *done: steps.append(done), **options)
    frames, durations = read_gif(tmp_path / "a.gif")
    assert durations.sum() == pytest.approx(video.duration)
    assert video.duration == pytest.approx((video.time + 0.1) / speed + HOLD, abs=1.5 / fps)
    assert len(frames) <= round(video.time / 0.1) + 1
    assert steps == [(step, 300) for step in range(round(video.time / 0.1) + 1)]


def test_an_mp4_plays_as_long_as_a_gif(tmp_path):
    ffmpeg = pytest.importorskip("imageio_ffmpeg").get_ffmpeg_exe()
    path = tmp_path / "a.mp4"
    video = record("bearing", path, seed=2, fps=30, width=478)
    assert video.size == (478, 526)
    decode = [ffmpeg, "-i", str(path), "-f", "rawvideo", "-pix_fmt", "rgb24", "-"]
    done = subprocess.run(decode, capture_output=True, check=True)
    assert b"Video: h264" in done.stderr
    assert b"478x526" in done.stderr
    assert b"30 fps" in done.stderr
    frames = np.frombuffer(done.stdout, np.uint8).reshape(-1, *video.size[::-1], 3)
    assert len(frames) == round(30.0 * video.duration)
    record("bearing", tmp_path / "a.gif", seed=2, width=478)
    for at, picture in zip((0, -1), read_gif(tmp_path / "a.gif")[0][[0, -1]], strict=True):
        assert np.abs(frames[at].astype(int) - picture).mean() < 3.0
    assert np.abs(frames[0].astype(int) - frames[-1]).mean() > 0.5  # the comparison would notice other frames


def test_the_command_writes_the_video_that_it_reports(tmp_path, capsys):
    path = tmp_path / "new" / "square.GIF"
    options = f"--env {SQUARE} --noise documented --robot tutorial --seed 2 --laps 1 --arrival belief".split()
    assert main(["video", *options, "--width", "320", "--speed", "20", "--out", str(path)]) == 0
    printed = capsys.readouterr()
    assert not printed.err
    assert f"{path}: " in printed.out
    assert "320 x 352 pixels" in printed.out
    assert f"{path.stat().st_size:,} bytes" in printed.out
    assert "in success" in printed.out
    assert read_gif(path)[0].shape[1:] == (352, 320, 3)
    assert [file.name for file in path.parent.iterdir()] == ["square.GIF"]


def test_a_gif_needs_none_of_the_extras_and_an_mp4_without_ffmpeg_names_what_to_install(tmp_path):
    code = """
import sys
from turtlebot_gym_agents.commands.cli import main
assert main(["video", "--speed", "40", "--width", "160", "--out", "a.gif"]) == 0
assert not {"torch", "onnxruntime", "stable_baselines3", "moviepy", "imageio_ffmpeg"} & set(sys.modules)
sys.modules["imageio_ffmpeg"] = None  # importing it raises
sys.exit(main(["video", "--out", "a.mp4"]))
"""
    done = subprocess.run([sys.executable, "-c", code], cwd=tmp_path, capture_output=True, text=True)
    assert done.returncode == 2, done.stderr
    assert "pip install imageio-ffmpeg" in done.stderr
    assert [path.name for path in tmp_path.iterdir()] == ["a.gif"]
    assert (tmp_path / "a.gif").read_bytes().startswith(b"GIF89a")
