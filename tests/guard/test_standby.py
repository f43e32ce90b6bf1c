"""The standby's rule in made-up time, and its node in this process; with a guard that dies it is tested in test_guard."""

import time
from types import SimpleNamespace

import numpy as np
import pytest
from geometry_msgs.msg import Twist, TwistStamped
from std_msgs.msg import Empty

from cmd_vel_guard.standby import ALONE, LINGER, CmdVelStandby, Standby

PERIOD = 0.02


def zeros_of(messages, end, *, late=()):
    """Return the times of the zeros for messages of a guard, (time, whether it moves), and times without a look."""
    rule, zeros, messages, own = Standby(), [], sorted(messages), []
    for now in np.arange(0.0, end, PERIOD).tolist():
        if any(first <= now < last for first, last in late):
            continue
        came = [moves for at, moves in messages if at <= now]
        del messages[: len(came)]
        acts = rule.look(own + came, now)
        assert rule.acts(now) is acts
        zeros += [now] * acts
        own = [False] * acts  # at the next look it hears itself
    return zeros, rule.takeovers


def speech(first, last, moves=True, period=0.05):
    return [(at, moves) for at in np.arange(first, last, period)]


def test_zeros_follow_the_silence_of_a_guard_that_moves_the_robot_for_a_second():
    zeros, takeovers = zeros_of(speech(0.5, 1.0), 4.0)
    last = 0.95
    assert last + 0.16 < zeros[0] <= last + 0.2
    assert zeros[-1] - zeros[0] == pytest.approx(0.98)
    assert np.diff(zeros) == pytest.approx(PERIOD)
    assert takeovers == 1


@pytest.mark.parametrize(
    "messages",
    [
        [],
        speech(0.5, 2.0, moves=False),
        [*speech(0.5, 1.0), (1.001, True), (1.002, False)],
        speech(0.5, 4.0),
        speech(0.5, 4.0, period=0.14),
    ],
    ids=["nobody", "a guard that stands", "a guard that stopped", "a guard that drives", "a guard that lost two messages"],
)
def test_a_guard_that_speaks_or_has_stopped_the_robot_is_left_alone(messages):
    assert zeros_of(messages, 4.0) == ([], 0)


def test_a_guard_that_speaks_again_is_obeyed_at_once_and_watched_again():
    zeros, takeovers = zeros_of([*speech(0.5, 1.0), *speech(1.5, 2.0)], 5.0)
    assert max(at for at in zeros if at < 1.6) < 1.5
    assert min(at for at in zeros if at > 1.6) == pytest.approx(2.13, abs=0.02)
    assert takeovers == 2
    stopped, takeovers = zeros_of([*speech(0.5, 1.0), *speech(1.5, 2.0, moves=False)], 5.0)
    assert stopped[-1] - stopped[0] == pytest.approx(0.98)
    assert takeovers == 1


def test_what_came_while_the_standby_was_held_up_is_dated_at_its_last_look_but_at_most_so_long_ago():
    for held, earliest in ((0.06, 1.0), (0.5, 1.4)):
        (first, *_), _ = zeros_of([*speech(0.5, 1.0), (1.0 + 0.5 * held, True)], 4.0, late=[(1.0 + 1e-9, 1.0 + held)])
        assert earliest + 0.16 <= first <= earliest + 0.22


@pytest.mark.parametrize("stamped", [True, False])
def test_the_node_sends_zeros_in_the_frame_of_the_guard_and_says_so(stamped, peer, wait_for, monkeypatch, make_runner):
    logged = []
    monkeypatch.setattr("cmd_vel_guard.standby.log", lambda node, level, text: logged.append(text))
    runner = make_runner("--ros-args", "-p", f"enable_stamped_cmd_vel:={str(stamped).lower()}")
    standby, kind = CmdVelStandby(runner.context), TwistStamped if stamped else Twist
    assert sorted(timer.timer_period_ns * 1e-9 for timer in standby.timers) == pytest.approx([PERIOD, 0.1])
    runner.add(standby)
    heard, alive = peer.hear("cmd_vel", kind), peer.hear("cmd_vel_standby/alive", Empty)
    time.sleep(0.5)
    assert not alive  # nobody else is on the topic
    guard = peer.speak("cmd_vel", kind)
    wait_for(lambda: alive and standby._guard.get_publisher_count() == 2 and guard.get_subscription_count() == 2)
    motion = kind()
    if stamped:
        motion.header.frame_id = "robot1/base_link"
        motion.twist.angular.z = 0.5
    else:
        motion.linear.x = 0.1
    guard.publish(motion)
    wait_for(lambda: len(heard) > 1)
    zero = heard[-1]
    assert (zero.twist if stamped else zero) == Twist()
    assert not stamped or (zero.header.frame_id == "robot1/base_link" and zero.header.stamp.sec > 0)
    assert logged == ["the guard fell silent for 0.18 s while the robot moved: zeros"]


@pytest.fixture
def standby(runner, peer, wait_for):
    """A standby that runs when the test calls it, whose steady clock the test sets, and a guard."""
    node, guard = CmdVelStandby(runner.context), peer.speak("cmd_vel", TwistStamped)
    wait_for(lambda: node._guard.get_publisher_count() == 2 and guard.get_subscription_count())
    yield node, guard
    node.destroy_node()


@pytest.fixture
def now(monkeypatch):
    """The standby's steady time, which the test sets."""
    times = [1e6]
    monkeypatch.setattr("cmd_vel_guard.standby.time", SimpleNamespace(monotonic=lambda: times[0]))
    return times


def test_one_that_was_asked_to_end_says_no_longer_that_it_lives_and_ends_after_the_guard(standby, peer, wait_for, now):
    (node, guard), alive = standby, peer.hear("cmd_vel_standby/alive", Empty)
    wait_for(lambda: node._live() or alive)
    assert not node.may_end(False)
    assert not node.may_end(True)
    before = len(alive)
    node._live()
    now[0] += LINGER - 0.1
    assert not node.may_end(True)
    peer.node.destroy_publisher(guard)
    wait_for(lambda: node._guard.get_publisher_count() == 1)
    node._rule.moves = True  # of a guard that was killed
    assert not node.may_end(True)
    node._rule.moves, node._rule._until = False, now[0] + 0.05
    assert not node.may_end(True)
    now[0] += 0.06  # its zeros were sent
    assert node.may_end(True)
    assert len(alive) <= before + 1  # one may have been on its way


def test_one_that_was_asked_to_end_does_not_wait_for_ever(standby, now):
    node, _ = standby
    assert [node.may_end(True) for now[0] in (2e6, 2e6 + LINGER, 2e6 + LINGER + 0.1)] == [False, False, True]


def test_an_orphan_ends_when_nobody_was_there_for_a_while_and_a_child_never(standby, peer, wait_for, monkeypatch, now):
    node, guard = standby
    assert not node.may_end(False)
    peer.node.destroy_publisher(guard)
    wait_for(lambda: node._guard.get_publisher_count() == 1)
    now[0] += ALONE + 0.1
    assert not node.may_end(False)
    monkeypatch.setattr("cmd_vel_guard.standby.os.getppid", lambda: 1)
    assert node.may_end(False)
    now[0] -= 0.2
    assert not node.may_end(False)


@pytest.mark.parametrize("moves", [True, False])
def test_the_last_word_of_a_standby_is_zero_if_a_motion_is_in_force(standby, peer, wait_for, moves):
    (node, guard), heard = standby, peer.hear("cmd_vel", TwistStamped)
    wait_for(lambda: guard.get_subscription_count() == 2 and node._velocity.get_subscription_count() == 2)
    motion = TwistStamped()
    motion.twist.linear.x = 0.1 if moves else 0.0
    guard.publish(motion)
    wait_for(lambda: heard)
    node.halt()
    guard.publish(motion)
    wait_for(lambda: len(heard) > 1 and heard[-1].twist == motion.twist)
    assert [message.twist for message in heard] == [motion.twist, *[Twist()] * (3 * moves), motion.twist]
