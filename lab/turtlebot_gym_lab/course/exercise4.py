"""Exercise 4: stop safely.

Between a program and the wheels sits a guard. It passes on commands while all is well, and zeros otherwise: when the program
dies, hangs or computes nonsense, and when somebody presses the emergency stop. Write one. Its `step` is called 20 times a
second.

Then: turtlebot-gym check exercise4.py. The page "Safety" says what the project's own guard does, and what it cannot do.
"""

EXERCISE = 4

MOST_LINEAR, MOST_ANGULAR = 0.2, 2.0  # m/s, rad/s
OLDEST = 0.4  # s: an older command is not obeyed
RELEASE = 0.5  # s without a press after which the emergency stop is released


class Guard:
    """Decides what the wheels do."""

    def step(self, now: float, command: tuple[float, float] | None, sent: float, pressed: bool) -> tuple[float, float]:
        """Return the speed (m/s) and turning rate (rad/s) for the wheels.

        Args:
            now: Time, s.
            command: The program's newest command, speed and turning rate; None before the first one.
            sent: When that command was sent, s.
            pressed: Whether an emergency stop has been pressed since the last call.
        """
        raise NotImplementedError
