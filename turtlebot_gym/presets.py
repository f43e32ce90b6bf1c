"""Named noise models and filter tunings."""

from __future__ import annotations

from turtlebot_gym.parameters import FilterTuning, Noise, OdometryNoise, ProcessNoise, choose
from turtlebot_gym.robots import ROBOTS, Robot

_SPIKES = {"spike_probability": 0.02, "spike": 0.3}
_DRIFT = ProcessNoise(alpha1=0.0, alpha2=0.0, alpha3=0.0, alpha4=0.0)

NOISES: dict[str, Noise] = {
    "clean": Noise(),
    "tutorial": Noise(odometry=OdometryNoise(R=(0.05, 0.05, 0.1), **_SPIKES)),
    "documented": Noise(
        odometry=OdometryNoise(R=(0.05**2, 0.05**2, 0.1**2), bias=(0.02, 0.0, 0.0), **_SPIKES),
    ),
    "wheel": Noise(process=_DRIFT, odometry=OdometryNoise(wheel=True)),
    "rough": Noise(
        process=ProcessNoise(slip=0.5, slip_start=0.01, slip_end=0.2),
        odometry=OdometryNoise(R=(0.02**2, 0.02**2, 0.02**2), dropout_probability=0.05, **_SPIKES),
    ),
}

TUTORIAL_FILTER = FilterTuning(
    Q=(0.01, 0.01, 0.02, 0.1, 0.1),
    R=(0.05, 0.05, 0.1),
    from_origin=True,
    P0=(0.1, 0.1, 0.1, 1.0, 1.0),
    remember_velocity=True,
    wrap_innovation=False,
)

FILTERS = ("tutorial", "matched")


def matched(noise: Noise) -> FilterTuning:
    process, odometry = noise.process, noise.odometry
    spikes = odometry.spike_probability * odometry.spike**2
    step = [q * q / 12.0 for q in odometry.quantization]
    R = odometry.R
    return FilterTuning(
        Q=(0.0, 0.0, 0.0, 0.005**2, 0.01**2),
        R=(max(R[0] + step[0], 1e-6), max(R[1] + step[0], 1e-6), max(R[2] + step[1] + spikes, 1e-6)),
        process=process,
        odometry_input=odometry.wheel,
    )


def make_robot(robot: str | Robot) -> Robot:
    return robot if isinstance(robot, Robot) else choose("robot", robot, ROBOTS)


def make_noise(noise: str | Noise) -> Noise:
    return noise if isinstance(noise, Noise) else choose("noise", noise, NOISES)


def make_filter(tuning: str | FilterTuning, noise: Noise) -> FilterTuning:
    if isinstance(tuning, FilterTuning):
        return tuning
    return choose("filter", tuning, {"matched": matched(noise), "tutorial": TUTORIAL_FILTER})
