"""The field test: each fault of a robot is named, nothing moves with one, and the report is written however it ends."""

import json
import math
import re
from dataclasses import replace
from types import SimpleNamespace
from typing import cast

import numpy as np
import pytest
from std_msgs.msg import Bool
from swallowed import require_end

from turtlebot_gym import read_parameters
from turtlebot_gym.parameters import Noise
from turtlebot_gym.presets import WHEEL
from turtlebot_gym.rooms.scan import Scan
from turtlebot_gym.values import STOP, Command, Odometry, Pose
from turtlebot_gym_lab.calibration.verdict import Verdict
from turtlebot_gym_lab.field import findings, program, session, steps
from turtlebot_gym_lab.field.findings import FINE, REFUSED, SKIPPED, WARNING, End, Figure, Finding, Topic
from turtlebot_gym_lab.field.measured import MeasuredDrive
from turtlebot_gym_lab.field.report import page
from turtlebot_gym_lab.field.session import Heard, TopicListener, _follow
from turtlebot_gym_lab.field.shared import Field
from turtlebot_gym_lab.field.steps import FieldStep, walk

ODOMETRY, STAMPED, TWIST = "nav_msgs/msg/Odometry", "geometry_msgs/msg/TwistStamped", "geometry_msgs/msg/Twist"
BOOL = "std_msgs/msg/Bool"
TIMES = 1e9 + np.arange(0.0, 5.0, 0.05)
ODOM = Topic("/odom", (End("turtlebot3_node", ODOMETRY, True),), (), TIMES, TIMES - 0.01)


def judged(topic):
    return findings.judge_topic(topic, ODOMETRY, needed=True, advice="start it")


class TestTopics:
    def test_a_topic_that_comes_in_time_is_fine(self):
        finding = judged(ODOM)
        assert finding.verdict == FINE
        assert finding.figures[0] == ("rate", pytest.approx(20.0), "Hz", *(pytest.approx(math.nan, nan_ok=True),) * 2)

    @pytest.mark.parametrize(
        ("fault", "verdict", "text"),
        [
            (ODOM._replace(publishers=()), REFUSED, "Nobody publishes /odom"),
            (ODOM._replace(publishers=(End("n", "geometry_msgs/msg/Pose", True),)), REFUSED, "published as geometry_msgs"),
            (ODOM._replace(arrivals=np.empty(0)), REFUSED, "0 messages came"),
            (ODOM._replace(publishers=ODOM.publishers * 2), REFUSED, "end one of them"),
            (ODOM._replace(arrivals=np.delete(TIMES, slice(20, 35))), WARNING, "A gap of more than 0.5 s"),
            (ODOM._replace(arrivals=TIMES[::8]), WARNING, "At less than 5 Hz"),
        ],
    )
    def test_missing_mistyped_silent_doubled_gapped_and_slow_ones_are_named(self, fault, verdict, text):
        finding = judged(fault)
        assert finding.verdict == verdict
        assert text in finding.text + finding.advice
        assert finding.advice


class TestClocks:
    @pytest.mark.parametrize(
        ("lead", "verdict"), [(0.0, FINE), (0.775, WARNING), (-0.3, WARNING), (2.5, REFUSED), (-0.8, REFUSED)]
    )
    def test_a_clock_is_judged_by_its_least_delayed_message(self, lead, verdict):
        delays = 0.12 * np.random.default_rng(0).random(len(TIMES))
        delays[7] = 0.0
        finding = findings.judge_clock("/odom", TIMES + delays, TIMES + lead)
        assert finding.verdict == verdict
        assert finding.figures[0].value == pytest.approx(lead, abs=1e-6)
        assert 0.1 < finding.figures[1].value < 0.12

    def test_messages_without_a_stamp_are_refused(self):
        assert findings.judge_clock("/odom", TIMES, 0.0 * TIMES).verdict == REFUSED


class TestOdometry:
    def test_zero_covariances_are_said_and_used(self):
        assert findings.judge_odometry(np.zeros((5, 3)), np.zeros((5, 2))).verdict == WARNING
        assert findings.judge_odometry(np.full((5, 3), 1e-3), np.zeros((5, 2))).verdict == FINE

    @pytest.mark.parametrize("bad", [math.nan, math.inf])
    def test_values_that_are_not_finite_are_refused(self, bad):
        assert findings.judge_odometry(np.zeros((5, 3)), np.full((5, 2), bad)).verdict == REFUSED


class TestScans:
    WHOLE = Scan(np.full(360, 2.0, np.float32), 0.0, 2.0 * math.pi / 360, 0.12, 3.5)

    def test_a_gap_wider_than_two_sectors_is_said(self):
        ranges = self.WHOLE.ranges.copy()
        ranges[100:130] = np.nan
        finding = findings.judge_scans([self.WHOLE._replace(ranges=ranges)])
        assert finding.verdict == WARNING
        assert finding.figures[-1].value == pytest.approx(31.0)

    def test_those_that_cannot_be_read_are_refused_with_the_reason(self):
        blind = self.WHOLE._replace(ranges=np.full(360, np.nan))
        finding = findings.judge_scans([self.WHOLE, blind])
        assert finding.verdict == REFUSED
        assert "none of the scan's 360 beams says anything" in finding.advice
        assert findings.judge_scans([self.WHOLE._replace(increment=0.0)]).verdict == REFUSED
        assert findings.judge_scans([]).verdict == SKIPPED


WHEELS = Topic(
    "/cmd_vel",
    (End("cmd_vel_guard", STAMPED, True), End("cmd_vel_standby", STAMPED, True)),
    (End("turtlebot3_node", STAMPED, True),),
)


class TestWheels:
    @pytest.mark.parametrize(
        ("topic", "verdict", "text"),
        [
            (WHEELS, FINE, "TwistStamped"),
            (WHEELS._replace(subscribers=()), REFUSED, "Nobody listens"),
            (WHEELS._replace(subscribers=(End("turtlebot3_node", TWIST, True),)), REFUSED, "it would hear nothing"),
            (WHEELS._replace(subscribers=(*WHEELS.subscribers, End("b", TWIST, True))), REFUSED, "is heard as"),
            (WHEELS._replace(publishers=(*WHEELS.publishers, End("teleop", STAMPED, True))), REFUSED, "teleop sends commands"),
        ],
    )
    def test_wrong_types_and_rivals_are_named(self, topic, verdict, text):
        finding = findings.judge_wheels(topic, kinds=(STAMPED, TWIST))
        assert (finding.verdict, text in finding.text) == (verdict, True)

    def test_guard_and_standby_must_run(self):
        assert findings.judge_guard(WHEELS).verdict == FINE
        missing = findings.judge_guard(WHEELS._replace(publishers=WHEELS.publishers[:1]))
        assert (missing.verdict, missing.text) == (REFUSED, "Missing: cmd_vel_standby.")


BUTTON = Topic("/emergency_stop", (End("button", BOOL, True),), (), TIMES)


class TestTheButton:
    @pytest.mark.parametrize(
        ("topic", "pressed", "verdict", "text"),
        [
            (BUTTON, False, FINE, "alive and released"),
            (BUTTON, True, REFUSED, "pressed"),
            (BUTTON._replace(publishers=()), False, REFUSED, "Nobody publishes"),
            (BUTTON._replace(publishers=(End("button", BOOL, False),)), False, REFUSED, "best effort"),
            (BUTTON._replace(arrivals=TIMES[::10]), False, REFUSED, "too rarely"),
            (BUTTON._replace(arrivals=np.empty(0)), False, REFUSED, "0 messages came"),
        ],
    )
    def test_one_that_could_not_stop_the_robot_is_refused(self, topic, pressed, verdict, text):
        finding = findings.judge_button(topic, pressed=pressed)
        assert (finding.verdict, text in finding.text) == (verdict, True)

    def test_a_press_must_stop_the_guard(self):
        assert findings.judge_press(0.02).verdict == FINE
        assert findings.judge_press(None).verdict == REFUSED


class Told:
    """A guard and a button that have said things at times, and the person who makes them say it."""

    def __init__(self, button, guard, refuses=""):
        self.said_then = {"emergency_stop": button, "cmd_vel_guard/enabled": guard}
        self.refuses = refuses
        self.heard = {"emergency_stop": [Heard(0.0, 0.0, Bool())], "cmd_vel_guard/enabled": [Heard(0.0, 0.0, Bool(data=True))]}

    def enable(self, node, enabled):
        return self.refuses

    def said(self, topic, value):
        return self.heard[topic][-1].message.data == value

    def number(self, key, text):
        return None

    def confirm(self, key, text):
        for topic, said in self.said_then.items():
            self.heard[topic] += [Heard(at, 0.0, Bool(data=data)) for at, data in said]
        return True


class TestAPress:
    @pytest.mark.parametrize(
        ("button", "guard", "delay"),
        [
            ([(1.0, False), (1.1, True), (2.0, False)], [(1.12, False)], 0.02),
            ([(1.0, False), (3.0, False)], [(1.5, False)], 0.5),  # its program was ended, and started again
            ([(1.0, False), (1.1, True), (2.0, False)], [], None),
        ],
    )
    def test_it_is_timed_from_the_button_to_the_guards_word(self, monkeypatch, tmp_path, button, guard, delay):
        monkeypatch.setattr(steps, "PRESSING", 0.05)
        stand_in = Told(button, guard)
        (finding,) = steps.try_the_button(
            Field(listener=cast(TopicListener, stand_in), person=stand_in, robot="burger", folder=tmp_path)
        )
        assert finding.verdict == (REFUSED if delay is None else FINE)
        assert [figure.value for figure in finding.figures] == ([] if delay is None else [pytest.approx(delay)])

    def test_a_guard_that_cannot_be_enabled_is_refused(self, monkeypatch, tmp_path):
        monkeypatch.setattr(session, "PATIENCE", 0.0)
        stand_in = Told([], [], refuses="cmd_vel_guard does not run")
        (finding,) = steps.try_the_button(
            Field(listener=cast(TopicListener, stand_in), person=stand_in, robot="burger", folder=tmp_path)
        )
        assert (finding.verdict, finding.text) == (REFUSED, "The guard refuses: cmd_vel_guard does not run.")


class TestMeasures:
    def judge(self, measured, by_odometry=1.0):
        return findings.judge_measure("a straight", "m", by_odometry=by_odometry, measured=measured, uncertainty=0.005)

    def test_the_interval_is_that_of_the_tape(self):
        share = self.judge(1.04, 2.0).figures[-1]
        assert (share.value, share.low, share.high) == pytest.approx((0.52, 0.5175, 0.5225))

    @pytest.mark.parametrize(("measured", "verdict"), [(0.98, FINE), (1.1, WARNING), (0.62, WARNING), (None, SKIPPED)])
    def test_odometry_that_is_off_is_said(self, measured, verdict):
        assert self.judge(measured).verdict == verdict

    def test_a_robot_that_did_not_move_says_nothing(self):
        assert self.judge(0.0, 0.01).verdict == REFUSED

    def test_a_slow_chain_is_said(self):
        assert findings.judge_latency([0.003] * 99 + [0.01]).verdict == FINE
        assert findings.judge_latency([0.3] * 100).verdict == WARNING
        assert findings.judge_latency([]).verdict == SKIPPED


@pytest.mark.parametrize(("is_good", "verdict", "scale"), [(True, FINE, 0.9), (False, WARNING, 0.8)])
def test_a_model_that_does_not_describe_the_drive_is_a_warning_and_gives_no_file(
    monkeypatch, tmp_path, is_good, verdict, scale
):
    def noise(scale):
        return replace(WHEEL, process=replace(WHEEL.process, scale=scale))

    fitted = SimpleNamespace(estimates={}, remarks=(), verdict=Verdict(is_good, "So it is."), noise=noise(0.9))
    monkeypatch.setattr("turtlebot_gym_lab.calibration.calibrate", lambda drive, kind: fitted)
    monkeypatch.setattr("turtlebot_gym_lab.drives.read", lambda path: None)
    monkeypatch.setattr(steps, "_by_tape", lambda at: (noise(0.8), [Finding("by tape", FINE, "")]))
    at = Field(listener=cast(TopicListener, None), person=Agrees(), robot="burger", folder=tmp_path)
    tape, fitted = steps.calibrate(at)
    assert fitted.verdict == verdict
    assert ["noise.yaml" in finding.text for finding in (tape, fitted)] == [not is_good, is_good]
    assert read_parameters(Noise, tmp_path / "noise.yaml").process.scale == scale


class TestTheMeasuredDrive:
    @pytest.mark.parametrize(("turns", "amount"), [(False, 1.0), (True, 2.0 * math.pi)])
    def test_it_ends_where_odometry_says(self, turns, amount):
        drive = MeasuredDrive(MeasuredDrive.Params(turns=turns, amount=amount, speed=0.8 if turns else 0.15))
        x, theta, last, fastest, answer = 0.0, 0.0, STOP, 0.0, {}
        for _ in range(2000):
            wrapped = math.remainder(theta, 2.0 * math.pi)
            answer = drive.step(0.05, Odometry(Pose(x, 0.0, wrapped), last, True))
            if not answer:
                break
            last = answer["command"]
            fastest = max(fastest, last.v, last.omega)
            x, theta = x + 0.05 * last.v, theta + 0.05 * last.omega
        assert answer == {}
        assert (theta if turns else x) == pytest.approx(amount, abs=0.01)
        assert (theta if not turns else x) == 0.0
        assert fastest == pytest.approx(0.8 if turns else 0.15)

    def test_a_reset_begins_anew(self):
        drive = MeasuredDrive(MeasuredDrive.Params(amount=0.5))
        drive.step(0.05, Odometry(Pose(0.0, 0.0, 0.0), STOP, True))
        drive.reset()
        assert drive.step(0.05, Odometry(Pose(5.0, 0.0, 0.0), STOP, True)) == {"command": Command(0.15, 0.0)}


class Agrees:
    def __init__(self, agrees=True):
        self.agrees, self.asked = agrees, []

    def confirm(self, key, text):
        self.asked.append(key)
        return self.agrees

    def number(self, key, text):
        return None


ESSENTIAL = tuple(name for step in steps.STEPS for name in step.essential)


@pytest.fixture
def taken(monkeypatch, tmp_path):
    """Take steps that find given things, and return which moved the robot, what was found, and the field."""

    def take(found, agrees=True, moved=lambda at: [Finding("a straight", FINE, "")]):
        moves, seen, at = (
            [],
            [],
            Field(listener=cast(TopicListener, None), person=Agrees(agrees), robot="burger", folder=tmp_path),
        )
        look = FieldStep("listening", lambda at: list(found), needs_robot=False, essential=ESSENTIAL)
        move = FieldStep("a straight", lambda at: [moves.append(at), *moved(at)][1:], "It will drive {distance:g} m")
        monkeypatch.setattr(steps, "STEPS", (look, move))
        walk(at, seen)
        return moves, seen, at

    return take


class TestNothingMoves:
    GOOD = tuple(Finding(name, FINE, "") for name in ESSENTIAL)

    def test_every_essential_is_known_before_the_first_motion(self):
        first = next(at for at, step in enumerate(steps.STEPS) if step.asks)
        assert {name for step in steps.STEPS[:first] for name in step.essential} == set(ESSENTIAL)
        assert set(ESSENTIAL) == {"/odom", "clock of /odom", "odometry", "wheels", "guard", "emergency stop", "a press"}

    def test_it_moves_where_all_is_well_and_the_person_agrees(self, taken):
        moves, seen, at = taken(self.GOOD)
        assert len(moves) == 1
        assert at.person.asked == ["a_straight"]
        assert findings.passed(seen)

    def test_a_robot_with_a_namespace_moves_too(self, taken):
        assert len(taken([topic._replace(name=topic.name.replace("/", "/robot1/")) for topic in self.GOOD])[0]) == 1

    def test_a_person_who_does_not_agree_keeps_it_standing(self, taken):
        moves, seen, _ = taken(self.GOOD, agrees=False)
        assert moves == []
        assert (seen[-1].verdict, seen[-1].text) == (SKIPPED, "The person did not agree.")

    @pytest.mark.parametrize("verdict", [REFUSED, SKIPPED, None])
    @pytest.mark.parametrize("namespace", ["", "/robot1"])
    @pytest.mark.parametrize("name", ESSENTIAL)
    def test_each_essential_that_is_not_fine_or_never_came_keeps_it_standing(self, taken, name, namespace, verdict):
        verdicts = {topic.name: verdict if topic.name == name else FINE for topic in self.GOOD}
        judged = [Finding(topic.replace("/", f"{namespace}/"), told, "") for topic, told in verdicts.items() if told]
        moves, seen, at = taken(judged)
        assert moves == []
        assert at.person.asked == []
        assert name in seen[-1].text


class TestFollowing:
    def test_a_drive_that_is_done_has_no_complaint(self):
        states = iter(["silent: not enabled", "active", "active", "stopping: done"])
        assert _follow(lambda: next(states), lambda: True, 5.0) == ""

    @pytest.mark.parametrize(
        ("state", "passes", "why"),
        [("silent: emergency stop", True, "silent: emergency stop"), ("active", False, "the guard has stopped the robot")],
    )
    def test_a_drive_that_is_stopped_is_given_up(self, monkeypatch, state, passes, why):
        monkeypatch.setattr("turtlebot_gym_lab.field.session.LOST", 0.05)
        assert _follow(lambda: state, lambda: passes, 5.0) == why

    @pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning")
    def test_the_wait_ends_at_an_interruption_that_a_destructor_has_swallowed(self, monkeypatch):
        require_end(monkeypatch, lambda: _follow(lambda: "active", lambda: True, 30.0))

    def test_no_drive_takes_for_ever(self):
        assert _follow(lambda: "active", lambda: True, 0.05) == "it took more than 0.05 s"


class TestTheReport:
    FOUND = (
        Finding("/odom", FINE, "It <comes>.", (Figure("rate", 20.0, "Hz"), Figure("scale", 1.02, "", 1.01, 1.03))),
        Finding("wheels", REFUSED, "They hear nothing.", (), "Start & wait."),
    )

    def test_it_is_one_file_that_asks_for_nothing(self):
        text = page(self.FOUND, about={"Robot": "<burger>"}, paths={"odometry": np.zeros((3, 2))}, scan=np.ones((4, 2)))
        assert not re.search(r"(src|href|url\()\s*=?", text)
        assert "https:" not in text
        for shown in ("It &lt;comes&gt;.", "Start &amp; wait.", "&lt;burger&gt;", "1.01 to 1.03", "1 fine, 1 refused"):
            assert shown in text

    def test_without_a_finding_it_says_so(self):
        assert "nothing was found" in page((), about={})

    @pytest.mark.parametrize("error", [KeyboardInterrupt, RuntimeError("the middleware ended")])
    def test_it_is_written_however_the_test_ends(self, monkeypatch, tmp_path, error):
        def ends(*_, **__):
            raise error

        monkeypatch.setattr(program, "_field", ends)
        assert program.main(["--out", str(tmp_path / "out")]) == 1
        (found,) = json.loads((tmp_path / "out" / "findings.json").read_text())
        assert found["verdict"] == REFUSED
        assert "the end" in (tmp_path / "out" / "report.html").read_text()


class TestAnswers:
    def test_a_file_answers_instead_of_a_person(self):
        person = program.Console({"a_straight": 1.01, "press": False}, agrees=True)
        assert person.number("a_straight", "How far?") == 1.01
        assert person.number("a_turn", "How far?") is None
        assert not person.confirm("press", "Press it")
        assert person.confirm("a_turn", "It will turn")

    def test_a_person_is_asked_until_it_is_a_number(self, monkeypatch):
        replies = iter(["a lot", "-1", "0.98", "", "y", ""])
        monkeypatch.setattr("builtins.input", lambda text: next(replies))
        person = program.Console({}, agrees=False)
        assert person.number("a_straight", "How far?") == 0.98
        assert person.number("a_straight", "How far?") is None
        assert person.confirm("a_straight", "It will drive")
        assert not person.confirm("a_straight", "It will drive")

    @pytest.mark.parametrize("wrong", [["--robot", "tank"], ["--distance", "-1"], ["--answers", "none.yaml"]])
    def test_bad_arguments_are_refused_before_anything_is_made(self, wrong, tmp_path, monkeypatch, capsys):
        monkeypatch.chdir(tmp_path)
        assert program.main([*wrong, "--out", "out"]) == 2
        assert capsys.readouterr().err.startswith("error: ")
        assert list(tmp_path.iterdir()) == []

    def test_a_folder_that_exists_is_kept(self, tmp_path, capsys):
        assert program.main(["--out", str(tmp_path)]) == 2
