"""Tables of the benchmark for the terminal."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from rich.table import Table


def tables(result: Mapping[str, Any]) -> list[Table]:
    """Return the tables of a result: environments, also beside busy processes if measured.

    Args:
        result: What `python -m harness.measure` has measured, as it stands in its JSON.
    """
    shown = [environments_table(result["environments"], title=conditions(result))]
    if "busy" in result:
        busy = result["busy"]
        shown.append(environments_table(busy["environments"], title=beside(busy["processes"])))
    return shown


def conditions(result: Mapping[str, Any]) -> str:
    """Describe the machine of the measurement, and its load."""
    machine, others = result["machine"], result["used_by_others"]
    busy = f"load {machine['load_before']:.1f} before"
    if others is not None:
        busy += f", other programs used {others:.1f} cores meanwhile"
    return f"{processor(machine)}; {busy}"


def processor(machine: Mapping[str, Any]) -> str:
    """Describe the cores of a machine."""
    return f"{machine['cores']} cores, {machine['cpu']} ({machine['llvm_cpu']})"


def beside(processes: int) -> str:
    """Describe a machine that a number of processes keep busy."""
    return f"beside {processes} busy process{'' if processes == 1 else 'es'}"


def environments_table(rows: Mapping[str, Mapping[str, Any]], *, title: str) -> Table:
    """Return a table of rates and ratios of environments.

    Args:
        rows: By name.
        title: Title of the table.
    """
    table = Table(
        "environment",
        "steps/s",
        "times CartPole",
        "in the rounds",
        "steps/CPU s",
        "times CartPole by CPU s",
        title=title,
        caption="medians over the rounds; CartPole is Gymnasium's, of the same size where that was measured",
    )
    for name, row in rows.items():
        if name == row["base"] and table.row_count:
            table.add_section()
        low, high = row["ratio_range"]
        between = "" if name == row["base"] else f"{low:.2f} to {high:.2f}"
        rates = f"{row['steps_per_second']:,.0f}", f"{row['ratio']:.2f}", between
        table.add_row(name, *rates, f"{row['steps_per_cpu_second']:,.0f}", f"{row['cpu_ratio']:.2f}")
    return table
