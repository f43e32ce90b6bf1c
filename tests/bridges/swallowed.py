"""An interruption that a destructor swallows, of which waits must take notice all the same."""

import signal
import sys
from threading import Event

import pytest

from cmd_vel_guard.session import ENDINGS
from turtlebot_gym_ros.base.process import be_interruptible


class Swallowing:
    """Whose destructor swallows an interruption."""

    def __del__(self):
        signal.raise_signal(signal.SIGINT)


def require_end(monkeypatch, wait):
    """Check that a wait ends, within 30 s, at an interruption that a destructor has swallowed before it."""
    before = {number: signal.getsignal(number) for number in (*ENDINGS, signal.SIGALRM)}
    monkeypatch.setattr(sys, "unraisablehook", sys.unraisablehook)
    monkeypatch.setattr("turtlebot_gym_ros.base.process._interrupted", Event())
    be_interruptible()
    signal.signal(signal.SIGALRM, lambda *_: pytest.fail("it waits on"))
    signal.alarm(30)
    try:
        Swallowing()
        with pytest.raises(KeyboardInterrupt):
            wait()
    finally:
        signal.alarm(0)
        for number, handler in before.items():
            signal.signal(number, handler)
