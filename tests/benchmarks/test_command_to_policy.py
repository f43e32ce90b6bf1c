"""The benchmark from command to policy: its arithmetic, and that it compares the same work."""

import pytest

import command_to_policy
from harness.turns import Turn

pytest.importorskip("stable_baselines3", reason="needs the extra [agents]")


def test_ratios_are_medians_of_the_rounds_ratios():
    cost = Turn
    rounds = [
        {"a": cost(4.0, 9.0), "b": cost(2.0, 3.0)},
        {"a": cost(3.0, 8.0), "b": cost(3.0, 1.0)},
        {"a": cost(9.0, 1.0), "b": cost(1.0, 1.0)},
    ]
    assert command_to_policy.ratio(rounds, "a", "b", "wall") == 2.0  # of 2, 1 and 9; so is that of the medians ...
    assert command_to_policy.ratio(rounds, "a", "b", "cpu") == 3.0  # ... but here it would be 8


def test_the_stopwatch_counts_every_second_once(monkeypatch):
    clock = iter([0.0, 1.0, 3.0, 4.0, 9.0, 10.0])
    monkeypatch.setattr(command_to_policy, "_now", lambda: (now := next(clock), 2.0 * now))
    watch = command_to_policy.Stopwatch()
    with watch.time("outer"):
        assert watch.timed("inner", lambda x: x + 1)(1) == 2
        with watch.time("inner"):
            pass
    assert watch.taken == {"inner": [7.0, 14.0], "outer": [3.0, 6.0]}  # 10 in all


def test_the_bare_learning_and_the_command_are_the_same_training(tmp_path, monkeypatch):
    """Both leave the same weights: what is compared is the same work."""
    import torch
    from stable_baselines3 import PPO

    from turtlebot_gym_agents.training import model as making
    from turtlebot_gym_agents.training import train as training

    made, make_model = [], making.make_model
    monkeypatch.setattr(making, "make_model", lambda *args, **kwargs: made.append(make_model(*args, **kwargs)) or made[-1])
    cost = command_to_policy.bare(command_to_policy.Config(steps=1))
    assert cost.wall > 0.0
    assert cost.cpu > 0.0
    training.train(training.TrainingConfig(steps=1, episodes=4, evaluations=1), tmp_path / "run", progress=False)
    bare, whole = (
        model.policy.state_dict() for model in (made[0], PPO.load(tmp_path / "run" / "checkpoint.zip", device="cpu"))
    )
    assert bare.keys() == whole.keys()
    assert all(torch.equal(bare[name], whole[name]) for name in bare)
