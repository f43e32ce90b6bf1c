"""The count of the inputs with the longest time and the most memory."""

import sys


def pytest_terminal_summary(terminalreporter):
    """Print how many inputs were taken and refused, which took longest, and the peak of the memory."""
    fuzzing = sys.modules.get("fuzzing")
    counted = fuzzing.COUNTED if fuzzing else {}
    for kind, number in sorted(counted.items()):
        terminalreporter.write_line(f"fuzz: {kind}: {number}")
    if fuzzing and counted:
        kind, longest = max(fuzzing.LONGEST.items(), key=lambda item: item[1])
        terminalreporter.write_line(
            f"fuzz: {sum(counted.values())} inputs, at most {longest:.1f} CPU s ({kind}), peak {fuzzing.peak() / 1e6:.0f} MB"
        )
