"""Filters of filterpy and from a file: what they say is what drives, and the rest is refused in one line."""

import gymnasium as gym
import numpy as np
import pytest

import turtlebot_gym as tg

kalman = pytest.importorskip("filterpy.kalman")
NOISE = tg.make_noise("documented")
TUNING = tg.make_filter("matched", NOISE)
NAV = "turtlebot_gym/TurtleBotNav-v0"


def motion(x, dt, u):
    """Move a unicycle: by its own twist where the state has one, which ``u`` replaces; by ``u`` otherwise."""
    v, omega = x[3:5] if len(x) > 3 else u
    moved = [x[0] + dt * v * np.cos(x[2]), x[1] + dt * v * np.sin(x[2]), x[2] + dt * omega]
    return np.array([*moved, *u][: len(x)])


class Own(kalman.ExtendedKalmanFilter):
    """Moves by a function of its own, as in the books."""

    def predict_x(self, u=0):
        self.F = np.eye(self.dim_x)
        self.x = motion(self.x, 0.1, u)


def of_filterpy(kind, states, **options):
    """Return an object with the matched filter's Q and R."""
    made = kind(dim_x=states, dim_z=3, **options)
    floor = np.array([1e-9, 1e-9, 1e-9]) if states == 5 else np.array([2.5e-7, 2.5e-7, 1e-6])
    made.Q = np.diag([*floor, *TUNING.Q[3:]][:states])
    made.R, made.P = np.diag(TUNING.R), np.diag([*TUNING.R, 1e-9, 1e-9][:states])
    made.x = np.ravel(made.x)
    return made


def unscented(states):
    points = kalman.MerweScaledSigmaPoints(states, alpha=0.5, beta=2.0, kappa=0.0)
    return of_filterpy(kalman.UnscentedKalmanFilter, states, dt=0.1, hx=lambda x: x[:3], fx=motion, points=points)


def drive(filter, steps=120, **options):
    """Return the estimates of a drive in curves, through north, west and south, and their mean error of the position, m."""
    env = gym.make(NAV, noise=NOISE, filter=filter, max_episode_steps=steps, **options)
    _, info = env.reset(seed=3)
    infos = [info]
    for _ in range(steps):
        *_, info = env.step(np.array([0.8, 0.25], np.float32))
        infos.append(info)
    estimates, truths = (np.array([one[key] for one in infos]) for key in ("estimate", "true_state"))
    return estimates, np.hypot(*(estimates - truths)[:, :2].T).mean()


def test_an_extended_filter_of_filterpy_is_the_packages_own_with_the_same_numbers(tmp_path):
    (tmp_path / "filter.yaml").write_text(f"Q: {[1e-9, 1e-9, 1e-9, *TUNING.Q[3:]]}\nR: {list(TUNING.R)}\n")
    theirs, ours = drive(of_filterpy(kalman.ExtendedKalmanFilter, 5)), drive(str(tmp_path / "filter.yaml"))
    np.testing.assert_allclose(theirs[0], ours[0], atol=1e-6)


@pytest.mark.parametrize(
    ("make", "fix"),
    [
        (lambda: of_filterpy(kalman.ExtendedKalmanFilter, 3), "beacons"),
        (lambda: unscented(5), "markers"),
        (lambda: unscented(3), None),
        (lambda: of_filterpy(Own, 3), "markers"),
    ],
    ids=["ekf3", "ukf5", "ukf3", "own"],
)
def test_each_kind_of_filterpy_filters_about_as_well(make, fix):
    given = make()
    before = np.array(given.x), np.array(given.P)
    assert drive(given, fix=fix)[1] < 1.3 * drive("matched", fix=fix)[1] < 0.05
    np.testing.assert_array_equal(given.x, before[0])  # the user's object stays as it is
    np.testing.assert_array_equal(given.P, before[1])


def correlated():
    made = of_filterpy(kalman.ExtendedKalmanFilter, 5)
    made.R[0, 1] = 0.001
    return made


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: kalman.ExtendedKalmanFilter, "an object of filterpy's .* got 'ExtendedKalmanFilter'"),
        (lambda: kalman.SquareRootKalmanFilter(5, 3), "got 'SquareRootKalmanFilter'"),
        (lambda: kalman.ExtendedKalmanFilter(4, 3), "of 3 or 5 states"),
        (correlated, "filter ExtendedKalmanFilter must be .* its R a diagonal matrix"),
    ],
)
def test_others_are_refused_in_one_line(make, message):
    with pytest.raises(ValueError, match=message) as caught:
        tg.make_filter(make(), NOISE)
    assert "\n" not in str(caught.value)
