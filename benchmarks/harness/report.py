"""Report of the benchmark: tables for the terminal, and a figure."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

from rich.table import Table

from harness.environments import GYMNASIUM, OURS
from turtlebot_gym.plotting import BLACK, BLUE, GREEN, ORANGE, VERMILLION

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

COLOURS = {OURS: BLUE, GYMNASIUM: "#777777", "gymnax": ORANGE, "envpool": GREEN}
"""Colour of each library's bars."""


def tables(result: Mapping[str, Any]) -> list[Table]:
    """Return the tables of a result: environments, also beside busy processes if measured, and training.

    Args:
        result: What `turtlebot-gym benchmark` has measured, as it stands in its JSON.
    """
    shown = [environments_table(result["environments"], title=conditions(result))]
    if "busy" in result:
        busy = result["busy"]
        shown.append(environments_table(busy["environments"], title=beside(busy["processes"])))
    if "training" in result:
        shown.append(_training_table(result))
    return shown


def conditions(result: Mapping[str, Any]) -> str:
    """Describe the machine of the measurement, and its load."""
    machine, others = result["machine"], result["used_by_others"]
    busy = f"load {machine['load_before']:.1f} before"
    if others is not None:
        busy += f", other programs used {others:.1f} cores meanwhile"
    return f"{processor(machine)}; {busy}"


def processor(machine: Mapping[str, Any]) -> str:
    """Describe the cores of a machine, and their caches if they are known."""
    caches = "".join(f", {name} {size}" for name, size in (machine.get("caches") or {}).items())
    return f"{machine['cores']} cores, {machine['cpu']} ({machine['llvm_cpu']}{caches})"


def beside(processes: int) -> str:
    """Describe a machine that a number of processes keep busy."""
    return f"beside {processes} busy process{'' if processes == 1 else 'es'}"


def environments_table(rows: Mapping[str, Mapping[str, Any]], *, title: str) -> Table:
    """Return a table of rates and ratios of environments.

    Args:
        rows: By name.
        title: Title of the figure or table.
    """
    table = Table(
        "environment", "steps/s", "times CartPole", "in the rounds", "steps/CPU s", "times CartPole by CPU s",
        title=title, caption="medians over the rounds; CartPole is Gymnasium's, of the same size where that was measured",
    )  # fmt: skip
    for name, row in rows.items():
        if name == row["base"] and table.row_count:
            table.add_section()
        low, high = row["ratio_range"]
        between = "" if name == row["base"] else f"{low:.2f} to {high:.2f}"
        rates = f"{row['steps_per_second']:,.0f}", f"{row['ratio']:.2f}", between
        table.add_row(name, *rates, f"{row['steps_per_cpu_second']:,.0f}", f"{row['cpu_ratio']:.2f}")
    return table


def _training_table(result: Mapping[str, Any]) -> Table:
    """Return a table of the speed of PPO with CPU seconds, also beside busy processes if measured."""
    trained = result["training"]
    table = Table("training with PPO", "", title=f"the adapter adds {result['adapter_ns']:.0f} ns a step")
    table.add_row("Sb3VecEnv over the vector environment, steps/s", f"{trained['steps_per_second']:,.0f}")
    table.add_row("DummyVecEnv over 64 scalar environments, steps/s", f"{trained['dummy_vec_env']:,.0f}")
    table.add_row("ratio", f"{trained['ratio']:.1f}")
    table.add_row("CPU seconds for a million steps, ours", f"{trained['cpu_seconds_per_million']:.1f}")
    if "python_us" in result:
        sizes, times = zip(*result["python_us"].items(), strict=True)
        name = f"Python of a vector step of {', '.join(sizes)} environments, microseconds"
        table.add_row(name, ", ".join(f"{time:.1f}" for time in times))
    busy = result.get("busy", {}).get("training")
    if busy:
        where, more = beside(result["busy"]["processes"]), busy["cpu_seconds_per_million"] / trained["cpu_seconds_per_million"]
        table.add_row(f"steps/s {where}", f"{busy['steps_per_second']:,.0f}")
        table.add_row(f"CPU seconds for a million steps {where}", f"{busy['cpu_seconds_per_million']:.1f}, {more:.2f} times")
    return table


def figure(result: Mapping[str, Any]) -> Figure:
    """Return a figure of the rates as bars on logarithmic scales, with marks for CPU seconds and for a busy machine.

    Rows of one thread are drawn if they were also measured beside busy processes.

    Args:
        result: What `turtlebot-gym benchmark` has measured, as it stands in its JSON.
    """
    from matplotlib.figure import Figure
    from matplotlib.lines import Line2D
    from matplotlib.patches import Patch

    busy = result.get("busy", {}).get("environments", {})
    rows = {name: row for name, row in result["environments"].items() if row["threads"] is None or name in busy}
    groups: dict[str, list[str]] = {}
    for name, row in rows.items():
        groups.setdefault(row["base"], []).append(name)
    heights = [0.8 + len(names) for names in groups.values()]
    drawn = Figure(figsize=(7.0, 2.2 + 0.36 * sum(heights)), layout="constrained")
    panels = drawn.subplots(len(groups), 1, squeeze=False, height_ratios=heights)[:, 0]
    for axes, (base, names) in zip(panels, groups.items(), strict=True):
        draw_group(axes, {name: rows[name] for name in names}, busy, base)
        scalar = rows[base]["size"] == 1
        axes.set_xlim(*_limits([row for row in (*rows.values(), *busy.values()) if (row["size"] == 1) == scalar]))
    panels[-1].set_xlabel("environment steps per second, logarithmic")
    present = dict.fromkeys(row["by"] for row in rows.values())
    handles: list[Any] = [Patch(facecolor=COLOURS.get(by, BLACK), label=by) for by in present]
    handles.append(Line2D([], [], linestyle="none", label="per CPU second", **_MARK))
    if busy:
        handles.append(Line2D([], [], linestyle="none", label=beside(result["busy"]["processes"]), **_BESIDE))
    drawn.legend(handles=handles, loc="outside lower center", ncols=3, frameon=False, fontsize=10)
    explained = "right: steps per second, and times Gymnasium's CartPole (line; dashed: twice)"
    drawn.suptitle(f"Speed on {result['machine']['cores']} cores\n{explained}", fontsize=10.5)
    return drawn


_MARK: dict[str, Any] = {"marker": "D", "color": BLACK, "markersize": 5.0, "mec": "white", "mew": 0.8}
_BESIDE: dict[str, Any] = {"marker": "o", "color": VERMILLION, "markersize": 7.0, "fillstyle": "none", "mew": 1.8}


def draw_group(axes: Axes, rows: Mapping[str, Any], busy: Mapping[str, Any], base: str) -> Axes:
    """Draw contenders with the same base, with lines at the base's rate and at twice that rate.

    Args:
        axes: Axes to draw into.
        rows: Rows by name, from top to bottom.
        busy: Rows measured beside busy processes.
        base: Name of the base.
    """
    from matplotlib.ticker import LogLocator, NullFormatter

    at = range(len(rows), 0, -1)
    right = axes.get_yaxis_transform()
    for y, (name, row) in zip(at, rows.items(), strict=True):
        single = row["threads"] == 1
        axes.barh(
            y, row["steps_per_second"], height=0.72, color=COLOURS.get(row["by"], BLACK), alpha=0.55 if single else 1.0,
            hatch="///" if single else None, edgecolor="white", linewidth=0.0,
        )  # fmt: skip
        axes.plot(row["steps_per_cpu_second"], y, linestyle="none", **_MARK)
        if name in busy:
            axes.plot(busy[name]["steps_per_second"], y, linestyle="none", **_BESIDE)
        axes.text(1.02, y, f"{_short(row['steps_per_second'])}, {row['ratio']:.2f}x", transform=right, va="center", fontsize=10)
    for factor, style in ((1.0, "-"), (2.0, "--")):
        axes.axvline(factor * rows[base]["steps_per_second"], color=BLACK, linestyle=style, linewidth=0.9, zorder=2.5)
    where = base.rpartition(", ")[0]
    names = [name.removeprefix(f"{where}, ").removeprefix("vector of ") for name in rows]
    axes.set_yticks(list(at), names, fontsize=10)
    axes.set_title(where, loc="left", fontsize=11)
    axes.set_xscale("log")
    axes.xaxis.set_major_locator(LogLocator(subs=(1.0, 3.0)))
    axes.xaxis.set_major_formatter(lambda rate, _: f"{rate / 1e6:g} M" if rate >= 1e6 else f"{rate / 1e3:g} k")
    axes.xaxis.set_minor_formatter(NullFormatter())
    axes.set_ylim(0.4, len(rows) + 0.6)
    axes.tick_params(axis="y", length=0)
    axes.spines[["top", "right"]].set_visible(False)
    return axes


def _limits(rows: Sequence[Mapping[str, Any]]) -> tuple[float, float]:
    """Return the ends of a scale that holds all rates."""
    rates = [rate for row in rows for rate in (row["steps_per_second"], row["steps_per_cpu_second"])]
    return 0.5 * min(rates), 2.5 * max(rates)


def _short(rate: float) -> str:
    return f"{rate / 1e6:.1f} M" if rate >= 1e6 else f"{rate / 1e3:.0f} k"
