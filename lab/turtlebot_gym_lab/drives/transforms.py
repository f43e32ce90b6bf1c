"""The pose of one frame in another by recorded transforms, in the plane."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from turtlebot_gym.models.angles import wrap_all
from turtlebot_gym.mounts import yaw_of_rotation
from turtlebot_gym_lab.drives.streams import Stream


class Transforms:
    """The tree of frames that messages on ``/tf`` and ``/tf_static`` state: each frame has one parent."""

    def __init__(self) -> None:
        self._above: dict[str, tuple[str, Stream]] = {}

    def hear(self, message: Any, received: float) -> None:
        """Take a message with ``transforms``; one without a stamp counts from when it was received, s."""
        for transform in message.transforms:
            parent, child = transform.header.frame_id.lstrip("/"), transform.child_frame_id.lstrip("/")
            at, q, stamp = transform.transform.translation, transform.transform.rotation, transform.header.stamp
            _, poses = self._above.setdefault(child, (parent, Stream()))
            poses.add(stamp.sec + stamp.nanosec * 1e-9 or received, (at.x, at.y, yaw_of_rotation(q.w, q.x, q.y, q.z)))

    def poses(self, frames: str, time: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return where a frame is in another one at some times, shape (n, 3); m, m, rad; NaN where it is unknown.

        Frames are ``PARENT.CHILD``, as evo names them, or ``CHILD`` in the frame above all others; times are in s.

        Raises:
            ValueError: If the child is not below the parent.
        """
        parent, _, child = frames.rpartition(".")
        chain, frame = [], child
        while frame in self._above and (frame != parent or not parent):
            frame, poses = self._above[frame]
            chain.append(poses)
        if not chain or (parent and frame != parent):
            known = ", ".join(f"{above}.{below}" for below, (above, _) in self._above.items())
            raise ValueError(f"no transforms lead from {parent or 'any frame'!r} to {child!r}; there are {known or 'none'}")
        pose = np.zeros((len(time), 3))
        for poses in chain:
            above = poses.interpolated(time) if len(poses) > 1 else np.tile(poses.values[0], (len(time), 1))
            sine, cosine = np.sin(above[:, 2]), np.cos(above[:, 2])
            x, y, turn = pose.T
            pose = above + np.stack([cosine * x - sine * y, sine * x + cosine * y, turn], axis=1)
        pose[:, 2] = wrap_all(pose[:, 2])
        return pose
