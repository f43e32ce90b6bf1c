"""The normalized innovation squared of a filter's last measurement, on its own topic.

The common packages have no message for a stamped number, so the NIS is sent as a diagnostic, `diagnostic_msgs/DiagnosticArray`,
on ``nis`` instead of ``/diagnostics``, since it accompanies each estimate. PlotJuggler can plot its values. They are decimals
that read back to the same number.
"""

from __future__ import annotations

import math

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from std_msgs.msg import Header

from turtlebot_gym_ros.node.values import Nis

SURPRISING = 16.27
"""NIS that one measurement in a thousand exceeds for a consistent filter (chi-square, 3 degrees of freedom)."""
_KEY = "nis"


def write_nis(nis: Nis, header: Header) -> DiagnosticArray:
    """Return the message of a NIS.

    Raises:
        ValueError: If the NIS is not finite.
    """
    value = float(nis.value)
    if not math.isfinite(value):
        raise ValueError(f"the NIS must be finite, got {value:g}")
    surprising = value > SURPRISING
    status = DiagnosticStatus(
        level=DiagnosticStatus.WARN if surprising else DiagnosticStatus.OK,
        name="innovation",
        message=f"above {SURPRISING}, as one in a thousand is" if surprising else "as expected",
        hardware_id=header.frame_id,
        values=[KeyValue(key=_KEY, value=repr(value))],
    )
    return DiagnosticArray(header=header, status=[status])


def read_nis(message: DiagnosticArray) -> Nis:
    """Return a message's NIS.

    Raises:
        ValueError: If the message has none, or one that is not a finite number.
    """
    told = [pair.value for status in message.status for pair in status.values if pair.key == _KEY]
    if len(told) != 1:
        raise ValueError(f"it must have one value named {_KEY!r}, but has {len(told)}")
    try:
        value = float(told[0])
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise ValueError(f"the NIS must be a finite number, got {told[0]!r}")
    return Nis(value)
