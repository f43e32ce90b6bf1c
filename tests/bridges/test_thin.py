"""A robot's installation: numpy and PyYAML, nothing that trains, draws or compiles, and the same numbers to the bit."""

import subprocess
import sys
from importlib.util import module_from_spec, spec_from_file_location
from pathlib import Path

import psutil
import pytest
from bench import guarded

ABSENT = (
    "llvmlite",
    "scipy",
    "matplotlib",
    "pygame",
    "gymnasium",
    "filterpy",
    "PIL",
    "tyro",
    "rich",
    "torch",
    "stable_baselines3",
    "onnx",
    "tensorboard",
    "mujoco",
)
ROS = ("rclpy", "geometry_msgs", "nav_msgs", "sensor_msgs", "diagnostic_msgs", "std_msgs", "std_srvs")
PROGRAM = Path(__file__).with_name("thin.py")
ROOT = Path(__file__).parents[2]


def thin():
    """Return the program as a module."""
    spec = spec_from_file_location("thin", PROGRAM)
    module = module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def run(*arguments):
    return subprocess.run([sys.executable, *arguments], capture_output=True, text=True, check=False, cwd=ROOT)


def without(body):
    """Return the arguments of a Python in which the packages of `ABSENT` are not installed."""
    return "-c", f"import sys; sys.path.insert(0, {str(PROGRAM.parent)!r}); import thin; import sys\n" + (
        f"sys.meta_path[:] = [thin.Without(finder, {ABSENT!r}) for finder in sys.meta_path]\n{body}"
    )


@guarded
def test_filter_policy_and_guard_give_the_same_bits_without_what_trains_and_draws():
    done = run(str(PROGRAM), *ABSENT, *ROS)
    assert done.returncode == 0, done.stderr
    *lines, loaded = done.stdout.splitlines()
    assert [tuple(map(float.fromhex, line.split())) for line in lines] == thin().drive()
    assert set(loaded.split()) <= {"numpy", "yaml"}


@guarded
def test_the_program_depends_on_what_it_computes():
    rows = thin().drive(5)
    assert len(set(rows)) == len(rows)


def declared(extra=None):
    """Return the names of the packages that the project declares."""
    tomllib = pytest.importorskip("tomllib", reason="needs Python 3.11")
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    needs = project["optional-dependencies"][extra] if extra else project["dependencies"]
    return {need.split(">")[0].split("[")[0] for need in needs}


def test_a_plain_installation_is_thin_and_the_extras_bring_the_rest():
    assert declared() == {"numpy", "pyyaml"}
    assert declared("deploy") == {"onnxruntime", "rosbags"}
    assert {"llvmlite", "scipy", "gymnasium", "matplotlib", "pygame", "tyro", "rich"} <= declared("gym")
    for extra in ("agents", "ros", "ros-kilted"):
        assert "turtlebot-gym" in declared(extra)  # each with [gym]


NODES = """
from importlib import import_module
nodes = "blocks.waypoints blocks.controller blocks.kalman_filter node.shell graph.status"
for name in [*nodes.split(), "blocks.localizer", "recording.logger"]:
    import_module(f"turtlebot_gym_ros.{name}")
import_module("cmd_vel_guard.guard")
from turtlebot_gym_agents.policies.bundle import BundlePolicy
print(*sorted(thin.installed()))
"""


@guarded
def test_the_robots_nodes_load_nothing_beside_ros_that_the_extra_deploy_does_not_bring():
    done = run(*without(NODES))
    assert done.returncode == 0, done.stderr
    foreign = {name for name in done.stdout.split() if not name.endswith(("_msgs", "_srvs", "_interfaces"))}
    brought_by_rosbags = {"rosbags", "lz4", "zstandard", "backports", "ruamel", "apsw"}
    assert foreign <= {"numpy", "yaml", "typing_extensions", *brought_by_rosbags}


TOGETHER = ["kalman_filter", "localizer", "velocity_controller", "waypoint_generator"]


@pytest.mark.parametrize("nodes", [pytest.param(["cmd_vel_standby"], marks=guarded), TOGETHER], ids=" ".join)
def test_a_robots_nodes_come_up_and_end_without_what_trains_and_draws(launch, peer, wait_for, nodes):
    body = f"from turtlebot_gym_ros.__main__ import main; raise SystemExit(main({nodes}))"
    process = launch(*without(body))
    wait_for(lambda: {*nodes} <= {*peer.node.get_node_names()} or process.poll() is not None)
    assert process.poll() is None, process.communicate()[1]
    process.terminate()
    assert process.wait(timeout=10.0) == 0


@pytest.mark.parametrize(
    ("missing", "node", "extra"),
    [("rosbags", "data_logger", "deploy"), pytest.param("rclpy", "cmd_vel_guard", "ros", marks=guarded)],
)
def test_a_node_says_what_to_install(missing, node, extra):
    body = f"from turtlebot_gym_ros.__main__ import main; raise SystemExit(main(['{node}']))"
    done = run("-c", without(body)[1].replace(repr(ABSENT), repr((missing,))))
    assert done.returncode == 2
    assert done.stderr.startswith(f"error: {missing} is missing: ")
    assert done.stderr.endswith(f"pip install 'turtlebot-gym[{extra}]'.\n")


def test_the_command_line_says_what_to_install():
    done = run(*without("from turtlebot_gym_agents.__main__ import main; raise SystemExit(main(['evaluate']))"))
    assert done.returncode == 2
    assert done.stderr == "turtlebot-gym: tyro is missing: pip install 'turtlebot-gym[gym]'.\n"


def compilers_in(process):
    """Return which of llvmlite and SciPy a process has loaded, by the libraries in its memory."""
    files = [Path(mapped.path).parts for mapped in psutil.Process(process.pid).memory_maps()]
    return {name for name in ("llvmlite", "scipy") if any(name in parts for parts in files)}


def test_nodes_load_no_compiler_where_one_is_installed(launch, peer, wait_for):
    nodes = [*TOGETHER, "turtlebot_simulator"]
    process = launch("-m", "turtlebot_gym_ros", *nodes)
    wait_for(lambda: {*nodes} <= {*peer.node.get_node_names()} or process.poll() is not None)
    assert process.poll() is None, process.communicate()[1]
    assert not compilers_in(process)


def test_a_process_with_a_compiled_loop_has_a_compiler(launch, wait_for, tmp_path):
    pytest.importorskip("llvmlite")
    program = tmp_path / "loop.py"  # what is compiled is read from its file
    program.write_text(
        "import scipy.stats, signal\nfrom turtlebot_gym.compiled.cache import compiled\n"
        "def loop(x):\n    return x + 1.0\n\ncompiled(loop, 'a loop')(1.0)\nsignal.pause()\n"
    )
    process = launch(str(program))
    wait_for(lambda: compilers_in(process) == {"llvmlite", "scipy"} or process.poll() is not None)
    assert process.poll() is None, process.communicate()[1]
