"""A solution of exercise 4."""

import math

EXERCISE = 4

MOST_LINEAR, MOST_ANGULAR = 0.2, 2.0  # m/s, rad/s
OLDEST = 0.4  # s
RELEASE = 0.5  # s


class Guard:
    def __init__(self) -> None:
        self.last_press = -math.inf

    def step(self, now: float, command: tuple[float, float] | None, sent: float, pressed: bool) -> tuple[float, float]:
        if pressed:
            self.last_press = now
        if now - self.last_press <= RELEASE or command is None:
            return 0.0, 0.0
        if not 0.0 <= now - sent <= OLDEST or not all(map(math.isfinite, command)):
            return 0.0, 0.0
        v, omega = command
        return max(-MOST_LINEAR, min(v, MOST_LINEAR)), max(-MOST_ANGULAR, min(omega, MOST_ANGULAR))
