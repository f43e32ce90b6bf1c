"""Overrides KEY=VALUE: every field reaches the environment or Stable-Baselines3, and what changes nothing is refused."""

import json
from dataclasses import fields, is_dataclass, replace
from functools import reduce
from inspect import signature
from typing import get_type_hints

import gymnasium as gym
import pytest
import tyro

pytest.importorskip("stable_baselines3", reason="needs the extra [agents]")


from turtlebot_gym import Options
from turtlebot_gym.parameters import KINDS
from turtlebot_gym_agents.commands.cli import Evaluate, main
from turtlebot_gym_agents.commands.fields import flags_of
from turtlebot_gym_agents.commands.flags import REGISTRY, Learning
from turtlebot_gym_agents.commands.learning import Train, Tune
from turtlebot_gym_agents.commands.overrides import extract, keys_of, override, parts_of
from turtlebot_gym_agents.commands.study import Study
from turtlebot_gym_agents.evaluation.evaluate import evaluate
from turtlebot_gym_agents.policies.bundle import BundlePolicy
from turtlebot_gym_agents.training.arguments import ALGORITHMS, arguments, names_of
from turtlebot_gym_agents.training.config import TrainingConfig
from turtlebot_gym_agents.training.hyperparameters import configs_folder
from turtlebot_gym_agents.training.model import make_model

SLOTS = {"filter": "tuning", "world": "room.rules", "lidar": "room.lidar"}
"""Places of options in the parameters of an environment, where they have other names."""
NEEDS = {
    "fix": {"fix": "localization"},
    "imu": {"imu": "calibrated", "filter": "gyro"},
    "world": {"env": "rooms"},
    "lidar": {"env": "rooms"},
    "localizer": {"env": "rooms", "noise": "wheel", "localizer": "match"},
    "plant": {"plant": "mujoco"},
    "task.random": {"env": "square"},
    "task.margin": {"arrival": "belief"},
    "task.start_known": {"env": "rooms", "noise": "wheel", "localizer": "match"},
    "task.patience": {"env": "missions"},
    "task.laps": {"env": "missions"},
    "task.switch_period": {"env": "square"},
    "noise.odometry.leap_probability": {"noise": "wheel"},
    "noise.odometry.reset_probability": {"noise": "wheel"},
    "noise.odometry.reverse_probability": {"noise": "wheel"},
    "filter.P0": {"filter": "tutorial"},
    "robot.lidar.frame": {},
}
"""What must be chosen so that a field is read."""
OF_KINDS = {"DeadReckoning": {"noise": "wheel"}, "Kalman": {}, "Gated": {"filter": "gated"}}


def given(command, *pairs, words=()):
    """Return a command with overrides, given as text."""
    return override(command, "command", [tuple(pair.split("=", 1)) for pair in pairs], words)


def texts(value):
    """Return texts of values that differ from one, of its type, from which a rule allows some."""
    if isinstance(value, bool):
        return [str(not value).lower()]
    if isinstance(value, str):
        return ["midpoint", "laser"]
    if isinstance(value, int):
        return [str(value + 1), str(value - 1)]
    if isinstance(value, float):
        near = (0.5 * value, 1.1 * value, value + 0.05, 0.125, 2.0, 1.0)
        return [repr(number) for number in near if number != value]
    if value and not isinstance(value[0], float):
        return ["[[1.0, 0.2]]"]
    rows = [json.dumps([1.5 * number for number in value]), json.dumps([1e-4 * (at + 1) for at, _ in enumerate(value)])]
    return [*rows, json.dumps([1.0 + number for number in value]), json.dumps([2.0, 2.0])]


def leaf(parameters, path):
    return reduce(getattr, path.split("."), parameters)


KEYS = [key for key in keys_of(Evaluate) if key.partition(".")[0] in parts_of(Evaluate) and "." in key and ".kind." not in key]
KIND_KEYS = [(name, item.name) for name, kind in KINDS.items() for item in fields(kind)]


def test_the_keys_are_all_fields_of_the_parameters_of_all_options():
    hints, expected = get_type_hints(Options), set()

    def walk(kind, prefix):
        for item in fields(kind):
            inner = get_type_hints(kind)[item.name]
            if isinstance(inner, type) and is_dataclass(inner):
                walk(inner, f"{prefix}.{item.name}")
            else:
                expected.add(f"{prefix}.{item.name}")

    terms = ("observation", "reward")  # they name terms, which are objects
    for name, hint in hints.items():
        for kind in getattr(hint, "__args__", ()) if name not in terms else ():
            if isinstance(kind, type) and is_dataclass(kind):
                walk(kind, name)
    assert set(KEYS) == expected - {"filter.kind"} - {key for key in expected if key.startswith("world.") and key not in KEYS}
    assert {item.name for item in fields(Options)} - {flag.key for flag in flags_of(Evaluate)} == {"task"}
    assert len(KEYS) > 120


def changed(path, needs):
    """Return the parameters of an environment, and the same with a field overridden, with its text."""
    name, _, rest = path.partition(".")
    command = given(Evaluate(), *(f"{key}={value}" for key, value in needs.items()))
    before = setup_of(command)
    slot = f"{SLOTS.get(name, name)}.{rest}"
    reasons = []
    for text in texts(leaf(before, slot)):
        try:
            after = setup_of(given(command, f"{path}={text}"))
        except ValueError as error:
            reasons.append(str(error))
            continue
        if leaf(after, slot) != leaf(before, slot):
            return before, after, slot
    raise AssertionError(f"{path}: no value was taken: {reasons}")


def setup_of(command):
    request = command.options() | {name: values[0] for name, values in command.axes().items()}
    options = {key: value for key, value in request.items() if key != "allow_mismatch"}
    base = {"task": registered(command.env)} | options
    return Options.of(base).setup().parameters


def registered(env):

    return gym.registry[env].kwargs["task"]


@pytest.mark.parametrize("path", KEYS)
def test_each_field_of_each_option_reaches_the_environment(path):
    needs = next((NEEDS[key] for key in (path, path.partition(".")[0]) if key in NEEDS), {})
    if path == "plant.wheel_separation":  # which must be the robot's
        with pytest.raises(ValueError, match="plant is a robot with a track of"):
            setup_of(given(Evaluate(), "plant=mujoco", f"{path}=0.2"))
        wider = given(Evaluate(), "plant=mujoco", f"{path}=0.2", "robot.wheel_separation=0.2")
        assert setup_of(wider).plant.wheel_separation == 0.2
        return
    before, after, slot = changed(path, needs)
    assert leaf(after, slot) != leaf(before, slot)
    others = [name for name in before._fields if name not in (slot.partition(".")[0], "tuning")]
    assert all(getattr(before, name) == getattr(after, name) for name in others)  # and nothing else does


@pytest.mark.parametrize(("kind", "name"), KIND_KEYS)
def test_each_number_of_each_filter_reaches_the_environment(kind, name):
    changed(f"filter.kind.{name}", OF_KINDS[kind])
    assert f"filter.kind.{name}" in keys_of(Evaluate)


@pytest.mark.parametrize("task", ["nav", "rooms", "missions"])
def test_each_term_of_the_reward_reaches_the_environment(task):
    plain = Train(env=task)
    before = plain.training().make(1).unwrapped.parameters.reward._asdict()
    for name in before:
        command = given(plain, f"reward.{name}=0.125")
        assert command.training().make(1).unwrapped.parameters.reward._asdict() == before | {name: 0.125}


VALUES = {
    "robot": "waffle",
    "noise": "rough",
    "filter": "gated",
    "observation": "odometry",
    "fix": "late",
    "imu": "calibrated",
    "world": "office",
    "lidar": "a1",
    "localizer": "match",
    "start": "unknown",
    "goals": "3",
    "arrival": "belief",
    "switch": "time",
    "laps": "2",
    "waypoints": "[[1, 0, 0], [1, 1, 0]]",
    "reward": "{effort: 0.2}",
    "dt": "0.05",
    "delay": "1",
    "integrator": "midpoint",
    "plant": "mujoco",
    "system": "turtlebot_gym.systems.open_ground:nothing",
    "task": "pose",
}
LOCALIZED = ("env=rooms", "noise=wheel", "localizer=match")
CONTEXTS = [(), ("env=square",), ("env=rooms",), ("env=missions",), LOCALIZED[:2], LOCALIZED, ("imu=mpu9250", "filter=gyro")]


@pytest.mark.sample(12)
@pytest.mark.parametrize("learning", [False, True])
@pytest.mark.parametrize("name", [item.name for item in fields(Options)])
def test_each_option_changes_the_environment_or_is_refused(name, learning):
    """Whatever is chosen besides, an option that would change nothing is refused, or of a filter said."""
    taken, refused = 0, 0
    for context in CONTEXTS:
        if any(pair.startswith(f"{name}=") for pair in context):
            continue
        base = Train() if learning else Evaluate()
        try:
            before = made(given(base, *context))
        except ValueError:  # the context is not one by itself
            continue
        try:
            after = made(given(base, *context, f"{name}={VALUES[name]}"))
        except (ValueError, ImportError):
            refused += 1
            continue
        assert after != before or VALUES[name] == "belief", context  # which is the default of missions
        taken += 1
    assert taken or refused
    assert taken or name in ("task", "system", "imu") or (name == "reward" and not learning)


def made(command):
    """Return what the environments of a command depend on."""
    if isinstance(command, Train):
        config = command.training()
        return Options.of({"task": registered(config.env), **config.options}).setup()
    request = command.options() | {name: values[0] for name, values in command.axes().items()}
    del request["allow_mismatch"]
    return Options.of({"task": registered(command.env), **request}).setup()


@pytest.mark.sample(12)
@pytest.mark.parametrize(
    ("words", "message"),
    [
        ("evaluate reward.effort=0.2", "reward changes nothing here, where nothing learns"),
        ("evaluate learning_rate=0.1", "learning_rate is a hyper-parameter, and evaluate trains nothing"),
        ("evaluate policy_kwargs.net_arch=[8]", "policy_kwargs.net_arch is a hyper-parameter, and evaluate trains nothing"),
        ("evaluate filter=[matched,gated] imu=mpu9250", "imu is not read by filter 'matched', 'gated'"),
        ("evaluate lidar.range_max=5", "world and lidar are for turtlebot_gym/TurtleBotRooms-v0"),
        ("evaluate fix.period=0.2", "fix.period changes a fix, and there is none: add one, such as fix=beacons"),
        ("evaluate plant.friction=0.5", "no fields, so friction must be left out"),
        ("evaluate plant=mujoco --friction 0.5 plant.friction=0.4", "plant.friction is given twice"),
        ("evaluate task=pose", "task is that of the environment: choose another one, such as env=pose"),
        ("evaluate task.margin=0.01", "task.margin would change nothing: it is for arrival='belief'"),
        ("train observation=truth filter=gated", "filter would change nothing: a policy that observes truth learns nothing"),
        ("train observation=truth fix=late", "fix would change nothing"),
        ("train observation=truth filter.R=[1,1,1]", "filter would change nothing"),
        ("train observation=odometry fix=late", "fix would change nothing: a policy that observes odometry"),
        ("train speed_error=0.1", "speed_error would change nothing without randomize"),
        ("train --veer 0.1", "veer would change nothing without randomize"),
        ("train n_timesteps=5", "n_timesteps is the option steps"),
        ("tune storage=a.journal gamma.x=1", "gamma.x is no hyper-parameter"),
        ("watch drive=[a.csv] noise=rough", "noise is for episodes, and changes nothing in recorded drives"),
        ("watch drive=[a.csv] robot.max_linear=0.1", "robot.max_linear is for episodes"),
        ("watch truth=none", "truth is for recorded drives: add --drive"),
        ("watch reward.time=1", "reward changes nothing here"),
        ("export a.zip rate=10 dt=0.1", "rate and dt exclude each other"),
        ("compile --all --system kalman", "system changes nothing with --all"),
        ("benchmark --tolerance 0.1", "tolerance changes nothing without --check"),
        (
            "evaluate nois=wheel",
            "evaluate has no 'nois'; `turtlebot-gym evaluate --help keys` lists what it has. Did you mean 'noise'?",
        ),
        ("evaluate noise.odometry.spik=1", "noise.odometry: OdometryNoise has no spik; it has"),
        ("train lerning_rate=1", "Did you mean 'learning_rate'?"),
        ("train policy_kwargs.net_arc=[8]", "Did you mean 'net_arch'?"),
        ("evaluate noise.base=rough", "evaluate has no 'noise.base'"),
        ("train nosuch.field=1", "train has no 'nosuch.field'"),
        ("evaluate episodes=many", "episodes must be a whole number, got 'many'"),
        ("evaluate dt=fast", "dt must be a number, got 'fast'"),
        ("evaluate details=perhaps", "details must be true or false, got 'perhaps'"),
        ("evaluate robot.max_linear=fast", "Robot.max_linear must be a positive number"),
        ("evaluate filter.R=[1,2]", "FilterTuning.R must be 3 numbers"),
        ("evaluate filter.R=[1,2", "filter.R must be a value in YAML"),
        ("train learning_rate=fast", "learning_rate must be a value such as 0.0003, got 'fast'"),
        ("train n_steps=2.5", "n_steps must be a value such as 2048, got 2.5"),
        ("evaluate --noise wheel noise=clean", "noise is given twice, as ('wheel',) and ('clean',): leave out one of them"),
        ("evaluate noise=wheel noise=clean", "noise is given twice"),
        ("evaluate tuning.R=[1,1,1] filter.R=[1,1,2]", "filter.R is given twice"),
        ("train reward.effort=0.1 --reward effort 0.2", "reward.effort is given twice"),
        ("train gamma=0.9 gamma=0.8", "gamma is given twice"),
    ],
)
def test_what_is_unknown_of_another_type_given_twice_or_changes_nothing_is_refused_in_one_line(
    words, message, capsys, tmp_path, monkeypatch
):
    monkeypatch.chdir(tmp_path)
    name, *rest = words.split()
    if name == "watch":
        for package in ("turtlebot_gym_lab", "turtlebot_gym_view"):
            pytest.importorskip(package, reason="needs the extra [view]")
    assert main([name, *rest]) == 2
    printed = capsys.readouterr()
    assert message in printed.err
    lines = [line for line in printed.err.splitlines() if line]
    assert len(lines) == 1, lines
    assert not [path for path in tmp_path.rglob("*") if path.is_file()]


def other(name, default):
    """Return another value of an argument of Stable-Baselines3 as text."""
    special = {"policy_kwargs": "{net_arch: [8]}", "train_freq": "[2, step]", "noise_type": "normal", "noise_std": "0.3"}
    special |= {"policy_kwargs.net_arch": "[8, 8]", "policy_kwargs.activation_fn": "Tanh", "policy": "MlpPolicy"}
    special |= {"policy_kwargs.optimizer_class": "AdamW", "ent_coef": "0.25", "target_entropy": "-3.5", "n_envs": "3"}
    if name in special:
        return special[name]
    if isinstance(default, bool):
        return str(not default).lower()
    if isinstance(default, int):
        return str(default + 1)
    return "{}" if "kwargs." not in name and "kwargs" in name else "0.25"


@pytest.mark.parametrize("algo", ALGORITHMS)
def test_each_hyper_parameter_reaches_stable_baselines3(algo):
    hyper = {"n_envs": 2, "n_timesteps": 16, "policy": "MlpPolicy"}
    plain = TrainingConfig(algo=algo, config=hyper)
    known = {name: item.default for name, item in signature(ALGORITHMS[algo]).parameters.items()}
    network = signature(ALGORITHMS[algo].policy_aliases["MlpPolicy"]).parameters.items()
    known |= {f"policy_kwargs.{name}": item.default for name, item in network}
    names = names_of(algo)
    assert {*known} - {*names} <= NOT_GIVEN | {f"policy_kwargs.{name}" for name in NOT_GIVEN}
    for name in names:
        text = "{}" if name.endswith("optimizer_kwargs") else other(name, known.get(name))
        overrides = given(Train(algo=algo), f"{name}={text}").overrides
        more = {"noise_std": {"noise_type": "normal"}}.get(name, {})
        config, (top, _, inner) = replace(plain, overrides={**more, **overrides}), name.partition(".")
        if name.endswith("buffer_class") or name == "action_noise":
            with pytest.raises(ValueError, match=f"{name} (is a class, which data cannot name|must be of type ActionNoise)"):
                arguments(algo, config.hyper)
        elif name in ("n_envs", "policy", "reward_scale"):
            assert config.hyper[name] == overrides[name]
        elif name in ("noise_type", "noise_std"):
            assert arguments(algo, config.hyper)["action_noise"]._sigma[0] == (0.3 if name == "noise_std" else 0.0)
        else:
            before, after = (arguments(algo, one.hyper) for one in (plain, config))
            assert (inner in after[top]) if inner else (top in after)
            assert after != before or overrides[name] == {}


NOT_GIVEN = {
    "env",
    "seed",
    "device",
    "tensorboard_log",
    "_init_setup_model",
    "observation_space",
    "action_space",
    "lr_schedule",
}
NOT_GIVEN |= {"use_sde", "features_extractor_class", "features_extractor_kwargs"}
"""Arguments that are options of a training, or set by it."""


def test_hyper_parameters_reach_the_model():
    pairs = ["learning_rate=3e-4", "n_steps=8", "batch_size=16", "gamma=0.5", "clip_range=0.1", "target_kl=0.02", "n_envs=4"]
    network = ["net_arch=[8]", "activation_fn=Tanh", "optimizer_kwargs.weight_decay=0.1"]
    command = given(Train(env="nav", steps=64), *pairs, *(f"policy_kwargs.{pair}" for pair in network))
    config = command.training()
    envs = config.make_training()
    model = make_model(config, envs)
    assert (model.learning_rate, model.n_steps, model.batch_size, model.gamma) == (3e-4, 8, 16, 0.5)
    assert (model.clip_range(1.0), model.target_kl, model.n_envs) == (0.1, 0.02, 4)
    assert [layer.out_features for layer in model.policy.mlp_extractor.policy_net if hasattr(layer, "out_features")] == [8]
    assert "Tanh" in str(model.policy.mlp_extractor)
    assert model.policy.optimizer.defaults["weight_decay"] == 0.1
    envs.close()


@pytest.mark.parametrize("command", [Train, Tune])
@pytest.mark.parametrize("name", [item.name for item in fields(Learning)])
def test_each_option_of_learning_changes_the_training_or_is_refused(command, name):
    flag = next(flag for flag in flags_of(command) if flag.path == (name,))
    values = {"algo": "sac", "from": "bearing", "device": "auto", "steps": "25", "config": str(configs_folder() / "sac.yaml")}
    text = values.get(flag.key) or other(name, flag.default)
    if name in ("speed_error", "turn_error", "veer"):
        with pytest.raises(ValueError, match=f"{name} would change nothing without randomize"):
            given(command(), f"{flag.key}={text}").training()
    before = command(randomize=name != "randomize").training()
    assert given(command(randomize=name != "randomize"), f"{flag.key}={text}").training() != before


def test_a_bundle_says_what_it_was_trained_on_and_is_evaluated_on_its_own_settings(tmp_path, capsys, monkeypatch):
    monkeypatch.chdir(tmp_path)
    environment = ["robot.max_linear=0.2", "dt=0.2", "noise.odometry.spike=0.5", "task.radius=0.3", "env=nav"]
    learning = [
        "learning_rate=3e-4",
        "policy_kwargs.net_arch=[8]",
        "reward.effort=0.2",
        "n_envs=8",
        "n_steps=8",
        "batch_size=64",
    ]
    run = ["--steps", "64", "--evaluations", "1", "--out", "run", "episodes=4"]
    assert main(["train", *environment, *learning, *run]) == 0
    printed = " ".join(capsys.readouterr().out.split())
    for text in ("dt 0.2", "robot.max_linear 0.2", "noise.odometry.spike 0.5", "reward effort 0.2", "learning_rate 0.0003"):
        assert text in printed, text
    recorded = json.loads((tmp_path / "run" / "config.json").read_text())
    assert recorded["config"]["noise"] == {"base": "tutorial", "odometry": {"spike": 0.5}}
    assert recorded["config"]["overrides"]["learning_rate"] == recorded["hyperparameters"]["learning_rate"] == 3e-4
    card = BundlePolicy(tmp_path / "run" / "policy.onnx").card
    assert card.env == "turtlebot_gym/TurtleBotNav-v0"
    assert (card.robot["max_linear"], card.dt) == (0.2, 0.2)
    assert card.training["config"] == recorded["config"]
    assert card.training["hyperparameters"] == recorded["hyperparameters"]
    driven = ["--policy", "run/policy.onnx", "--episodes", "4"]
    assert main(["evaluate", *environment, *driven, "--json", "own.json"]) == 0
    printed = capsys.readouterr()
    assert "dt 0.2" in printed.out
    assert printed.err.strip() == (
        "turtlebot-gym: with dt 0.2 s an episode of 300 steps lasts at most 60 s; task.max_steps=150 keeps 30 s."
    )
    own = json.loads((tmp_path / "own.json").read_text())
    assert own["runs"][0]["config"]["task"] == {"base": "nav", "radius": 0.3}
    assert own["config"]["changes"]["noise"] == {"odometry": {"spike": 0.5}}
    assert main(["evaluate", *driven]) == 2
    assert "made for 5 Hz" in capsys.readouterr().err
    assert main(["export", "run", "--allow-pickle", "--out", "again.onnx"]) == 0
    again = BundlePolicy(tmp_path / "again.onnx").card
    assert (again.robot, again.dt, again.noise) == (card.robot, card.dt, card.noise)
    assert main(["export", "run", "--allow-pickle", "--out", "other.onnx", "robot.radius=0.2"]) == 0
    assert BundlePolicy(tmp_path / "other.onnx").card.robot == {**card.robot, "radius": 0.2}


def test_filters_are_compared_on_the_same_seeds(tmp_path, capsys):
    words = ["evaluate", "--policy", "bearing", "--noise", "rough", "--episodes", "6", "--json", str(tmp_path / "a.json")]
    filters = ("matched", "gated", "tutorial")
    assert main([*words, "--filter", *filters]) == 0
    *_, first, second = capsys.readouterr().out.splitlines()
    assert first.startswith("gated ")
    assert second.startswith("tutorial ")
    runs = json.loads((tmp_path / "a.json").read_text())["runs"]
    assert [(run["label"], run["config"]["filter"]) for run in runs] == [
        (name, name) for name in ("matched", "gated", "tutorial")
    ]
    expected = evaluate("bearing", noise="rough", filter="gated", episodes=6).episodes
    assert runs[1]["episodes"]["time"] == pytest.approx(expected.time)
    assert runs[0]["episodes"]["seed"] == runs[1]["episodes"]["seed"]


def parsed(*words):
    """Return the command that the words of a command line make."""
    kept, pairs = extract(Train, words)
    return override(tyro.cli(Train, args=kept, registry=REGISTRY), "train", pairs, kept)


def test_overrides_and_flags_of_the_same_name_are_the_same():
    flags = parsed("--env", "square", "--noise", "rough", "--laps", "2", "--randomize", "--from", "bearing")
    assert flags.env == "turtlebot_gym/TurtleBotSquare-v0"
    assert flags == parsed("env=Square", "noise=rough", "laps=2", "randomize=true", "from=bearing")
    assert flags == parsed("env=square", "--noise", "rough", "noise=rough", "--laps=2", "laps=2", "--randomize", "from=bearing")


@pytest.mark.parametrize(
    ("words", "kept", "pairs"),
    [
        ("--policy a b noise=clean", "--policy a b", [("noise", "clean")]),
        ("--json lr=3 noise=clean --details seed=3", "--json lr=3 noise=clean --details", [("seed", "3")]),
        ("noise=clean --details seed=3", "--details", [("noise", "clean"), ("seed", "3")]),
        ("--json=a.json seed=3 x", "--json=a.json x", [("seed", "3")]),
        ("reward.own.terms:SMOOTH=1", "", [("reward.own.terms:SMOOTH", "1")]),
    ],
)
def test_a_word_after_a_flag_belongs_to_it(words, kept, pairs):
    assert extract(Evaluate, words.split()) == (kept.split(), pairs)


def test_other_commands_have_no_overrides():
    words = ["drive.csv", "--columns", "time=t", "v=speed"]
    assert extract(Study, words) == (words, [])
