"""The benchmark protocol: which policies can enter, the same numbers as `evaluate`, and one table of entries."""

import json

import pytest

from turtlebot_gym_agents.commands.cli import main
from turtlebot_gym_agents.evaluation import protocol
from turtlebot_gym_agents.evaluation.evaluate import evaluate
from turtlebot_gym_agents.evaluation.protocol import SEED, SETTINGS, settings_for
from turtlebot_gym_agents.evaluation.tune_baseline import TUNING_SEED
from turtlebot_gym_agents.policies.fit import ROOMS
from turtlebot_gym_agents.training.callbacks import EVALUATION_SEED
from turtlebot_gym_agents.training.model import NORMALIZATION_SEED, TRAINING_SEED


@pytest.fixture
def short(monkeypatch):
    """The settings with a few episodes each, without the long ones."""
    few = {name: setting._replace(episodes=4) for name, setting in SETTINGS.items() if name in ("nav, rough", "rooms, dense")}
    monkeypatch.setattr(protocol, "SETTINGS", few)


def test_each_policy_enters_where_it_can_drive():
    kinds = {name: {key.partition(",")[0] for key in settings_for(name)} for name in ("bearing", "vfh", "ppo-nav", "ppo-rooms")}
    rooms = {"rooms", "missions"}
    assert kinds == {"bearing": {"nav", *rooms}, "vfh": rooms, "ppo-nav": {"nav"}, "ppo-rooms": rooms}
    with pytest.raises(ValueError, match="no setting of its task, turtlebot_gym/TurtleBotPose-v0"):
        settings_for("ppo-pose")


def test_a_localizer_enters_where_there_is_wheel_odometry():
    assert list(settings_for("vfh", "match")) == ["missions, office"]
    with pytest.raises(ValueError, match="with localizer 'match' those on wheel odometry only"):
        settings_for("ppo-nav", "match")


@pytest.mark.parametrize("localizer", [None, "match"])
def test_a_mission_is_driven(monkeypatch, localizer):
    monkeypatch.setattr(protocol, "SETTINGS", {"missions, office": SETTINGS["missions, office"]._replace(episodes=1)})
    row = protocol.run("vfh", localizer=localizer)["rows"]["missions, office"]
    assert {"goals", "lost", "estimate_position_mean"} <= {*row}
    assert row["lost"]["value"] == 0.0
    assert row["estimate_position_mean"]["value"] < (0.02 if localizer else 1.0)


def test_its_seeds_are_apart_from_those_of_trainings_their_evaluations_and_tunings():
    last = SEED + max(setting.episodes for setting in SETTINGS.values())
    assert last < min(TUNING_SEED, EVALUATION_SEED, NORMALIZATION_SEED, TRAINING_SEED)
    assert SEED > 10_000_000  # published results drive on seeds from 0 to a few millions


@pytest.mark.usefixtures("short")
def test_an_entry_has_the_numbers_of_an_evaluation_and_stands_in_a_table(tmp_path, capsys):
    ours, theirs = tmp_path / "vfh.json", tmp_path / "bearing.json"
    assert main(["protocol", "run", "--policy", "vfh", "--filter", "tutorial", "--json", str(ours)]) == 0
    assert main(["protocol", "run", "--policy", "bearing", "--json", str(theirs)]) == 0
    entry = json.loads(ours.read_text())
    assert entry["entry"] == {"policy": "vfh", "filter": "tutorial", "localizer": None, "sha256": None}
    assert list(entry["rows"]) == ["rooms, dense"]
    options = {"world": "dense", "lidar": "lds01", "noise": "tutorial", "filter": "tutorial"}
    summary = evaluate("vfh", env=ROOMS, episodes=4, seed=SEED, **options).summary()
    assert entry["rows"]["rooms, dense"]["time"] == pytest.approx(summary["time"]._asdict())
    assert "commit" in entry
    capsys.readouterr()
    assert main(["protocol", "table", str(ours), str(theirs)]) == 0
    out = capsys.readouterr().out
    assert out.count("vfh, tutorial") == 1
    assert out.count("bearing, matched") == 2


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["walk"], "action must be one of 'run', 'table', got 'walk'"),
        (["table"], "name the entries of the table"),
        (["table", "other.json"], "it must be an entry of turtlebot-gym-protocol/1, got 'other'"),
        (["run", "other.json"], "run takes no entries"),
        (["run", "--policy", "ppo-square"], "the protocol has no setting of its task"),
    ],
)
def test_invalid_entries_and_arguments_are_refused_in_one_line(arguments, message, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "other.json").write_text('{"format": "other"}')
    assert main(["protocol", *arguments]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert message in line


def test_the_settings_do_not_change_without_another_format():
    """Entries of different settings must not stand in one table."""
    assert protocol.FORMAT == "turtlebot-gym-protocol/1"
    assert {name: setting.episodes for name, setting in SETTINGS.items()} == {
        "nav, tutorial": 1000, "nav, documented": 1000, "nav, rough": 1000, "rooms, dense": 500, "rooms, corridor": 500,
        "rooms, office": 500, "missions, office": 50,
    }  # fmt: skip
    assert SEED == 20_260_000
