"""A stamp that is far from those around it costs its row, in every form of recording, and nothing else."""

import numpy as np
import pytest
from drawing import columns_of, draw, write
from hypothesis import Phase, given, settings
from hypothesis import strategies as st
from rosbag_messages import ODOMETRY, POSE, TF, header, make, odometry, pose, transform, write_bag, write_ros_1

from turtlebot_gym_lab.drives import bags, laser, read, tables
from turtlebot_gym_lab.drives.clocks import continued, strays

pytestmark = pytest.mark.touched("lab", "tests/lab")

START = 1.7e9
DRAWN = draw(240)
EXACT = ("time", "twist", "odometry", "true_state", "joined")
FAR = st.sampled_from([0.0, 1.0, 12345.0, START - 86400.0, START + 5000.0, 2.0**32, 1e10])


def table(folder, rows):
    """Write a table with a row for each number of a row and stamp."""
    columns = columns_of(DRAWN)
    taken = [k for k, _ in rows]
    columns = {name: values[taken] for name, values in columns.items()}
    columns["t"] = np.array([stamp for _, stamp in rows])
    return write(folder / "drive.csv", columns)


def arrays(folder, rows):
    taken = [k for k, _ in rows]
    ranges = np.full((len(taken), 180), 150) + np.array(taken)[:, None]
    np.savez(folder / "a.npz", time=[stamp for _, stamp in rows], odometry=DRAWN.odometry[taken], ranges_cm=ranges)
    return folder / "a.npz"


def bag(folder, rows):
    """Write a bag, whose messages are received in time whatever their stamps say."""
    messages = []
    for at, (k, stamp) in enumerate(rows):
        received = START + DRAWN.time[k] + 1e-3 + 1e-5 * at
        messages.append(("/odom", ODOMETRY, received, odometry(stamp, DRAWN.odometry[k], DRAWN.twist[k])))
        true = make(POSE, header(START + DRAWN.time[k]), pose(*DRAWN.truth[k]))
        messages.append(("/ground_truth", POSE, received, true))
    return write_bag(folder / "bag", messages)


def tree(folder, rows):
    """Write a bag of ROS 1 whose truth is in transforms; a fixed one is repeated without a stamp."""
    messages = []
    for at, (k, stamp) in enumerate(rows):
        received = START + DRAWN.time[k] + 1e-3 + 1e-5 * at
        messages.append(("/odom", ODOMETRY, received, odometry(START + DRAWN.time[k], DRAWN.odometry[k], DRAWN.twist[k])))
        moving, fixed = transform(stamp, DRAWN.truth[k], "base", "map"), transform(0.0, (0.0, 0.0, 0.0), "laser", "base")
        messages.append(("/tf", TF, received, make(TF, [fixed, moving] if k % 2 else [moving])))
    return write_ros_1(folder / "drive.bag", messages)


def clean():
    return [(k, START + float(DRAWN.time[k])) for k in range(len(DRAWN))]


FORMS = {"table": table, "arrays": arrays, "bag": bag}


@pytest.mark.sample(1)
@pytest.mark.parametrize("form", FORMS)
@settings(max_examples=4, phases=(Phase.generate,))
@given(inserted=st.lists(st.tuples(st.integers(0, len(DRAWN)), FAR), min_size=1, max_size=8))
def test_strays_change_nothing_and_are_counted(tmp_path_factory, form, inserted):
    rows = clean()
    for at, stamp in sorted(inserted, reverse=True):
        if form != "bag" or stamp < 2**31:  # a stamp of ROS is no later
            rows.insert(at, (min(at, len(DRAWN) - 1), stamp))
    expected, drive = (read(FORMS[form](tmp_path_factory.mktemp("drive"), each)) for each in (clean(), rows))
    assert not any("far from those" in remark for remark in expected.remarks)
    number = len(rows) - len(expected)
    if number:
        (remark,) = [remark for remark in drive.remarks if "far from those around" in remark]
        assert f"{number} of {len(rows)}" in remark
    for name in EXACT:
        np.testing.assert_array_equal(getattr(drive, name), getattr(expected, name), err_msg=name)


def test_a_transform_with_a_stray_stamp_is_left_out_and_one_that_never_has_a_stamp_is_not(tmp_path):
    rows = [(k, {50: 0.0, 120: 12345.0, 121: START + 9e5}.get(k, stamp)) for k, stamp in clean()]
    drive = read(tree(tmp_path, rows), truth="/tf:map.laser")
    assert any("/tf:map.base: 3 transforms have a stamp that is 0, or far" in remark for remark in drive.remarks)
    there = np.ones(len(DRAWN), np.bool_)
    there[[50, 120, 121]] = False  # between its neighbours there
    np.testing.assert_allclose(drive.truth[there], DRAWN.truth[there], atol=1e-6)


def test_a_row_that_has_lost_its_stamp_costs_that_row_alone(tmp_path):
    rows = [(k, 0.0 if k == 100 else stamp) for k, stamp in clean()]
    drive = read(table(tmp_path, rows))
    assert len(drive) == len(DRAWN) - 1
    assert np.ptp(drive.time) < 60.0
    assert np.flatnonzero(~drive.joined).tolist() == [0, 100]  # its twist is lost with it


@pytest.mark.parametrize("relative", [0.0, START])
def test_clocks_that_were_set_and_pauses_are_no_strays(relative):
    time = relative + 0.1 * np.arange(600)
    paused, back, slow = time.copy(), time.copy(), relative + 60.0 * np.arange(600)
    paused[200:] += 30.0
    paused[205:] += 30.0  # a few rows between two pauses
    back[300:] -= 25.0
    for each in (time, paused, back, slow, time[:2], time[:3], paused[:203]):
        assert not strays(each).any()
    assert strays(np.where(np.arange(600) == 300, relative - 1e6, time)).sum() == 1


@pytest.mark.parametrize("steps", [[], [-100.0], [1e9] * 20, [-1e9] * 20, [1e9, 0.1, -1e9]])
def test_times_of_any_kind_increase_or_stay(steps):
    time, _, _ = continued(np.concatenate([[5.0], 5.0 + np.cumsum(steps)]), "a.csv")
    assert (np.diff(time) > 0.0).all()


def test_the_truth_in_a_file_of_its_own_loses_no_more_than_its_strays(tmp_path):
    drive = read(table(tmp_path, clean()))
    columns = {"t": START + DRAWN.time, "x": DRAWN.truth[:, 0], "y": DRAWN.truth[:, 1], "theta": DRAWN.truth[:, 2]}
    columns["t"] = np.where(np.arange(len(DRAWN)) == 40, 1e10, columns["t"])
    truth = write(tmp_path / "truth.csv", columns)
    seen = read(tmp_path / "drive.csv", truth=truth)
    assert np.isfinite(seen.truth[:, 0]).sum() == len(drive)


@pytest.mark.parametrize("form", FORMS)
def test_a_robot_without_a_clock_of_its_own_drives_on_when_the_network_sets_it(tmp_path, form):
    rows = [(k, stamp - (START - 50.0 if k < 100 else 0.0)) for k, stamp in clean()]
    drive = read(FORMS[form](tmp_path, rows))
    assert len(drive) == len(DRAWN)
    np.testing.assert_allclose(drive.time - drive.time[0], DRAWN.time, atol=0.01)
    assert any("the clock was set ahead 1 times, first by 1699999" in remark for remark in drive.remarks)


@pytest.mark.parametrize(
    ("form", "module", "name"), [("table", tables, "strays"), ("bag", bags, "stray_stamps"), ("arrays", laser, "strays")]
)
def test_the_law_of_strays_can_fail(tmp_path, monkeypatch, form, module, name):
    monkeypatch.setattr(module, name, lambda time, **_: np.zeros(len(time), np.bool_))
    rows = clean()
    rows.insert(120, (120, START - 7200.0))
    drive = read(FORMS[form](tmp_path, rows))
    assert len(drive) != len(DRAWN) or np.ptp(drive.time) > 2.0 * np.ptp(DRAWN.time)
