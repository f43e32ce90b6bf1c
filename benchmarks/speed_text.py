"""The section on speed in the page of results, from `speed.json`."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from harness.peer import SCANNED
from harness.report import beside, processor
from harness.tables import markdown

LIBRARIES = {"turtlebot_gym": "ours", "gymnasium": "Gymnasium"}


def section(found: Mapping[str, Any], *elsewhere: Mapping[str, Any]) -> str:
    """Return the section, in Markdown.

    Args:
        found: Result of `turtlebot-gym benchmark --json`.
        elsewhere: Results of other processors.
    """
    config, machine, others = found["config"], found["machine"], found["used_by_others"]
    meanwhile = "" if others is None else f", of which other programs used {others:.1f} meanwhile"
    newer = next((f"version {other['version']}" for other in elsewhere if other["version"] != found["version"]), None)
    lines = [
        "\n## Speed\n",
        *([f"This is of version {found['version']}, which was slower; [{newer}](#by-processor) is below.\n"] if newer else []),
        "![Steps per second of ours and of other libraries, by size](benchmarks/speed.png)\n",
        f"`make bench-peers`: contenders take turns in {config['rounds']} rounds, and medians count. Ratios are to Gymnasium's",
        "CartPole, which has neither noise nor filter, in the same rounds. CPU seconds are those of all threads. Measured on",
        f"{processor(machine)}{meanwhile} ({machine['system']},",
        f"{machine['python']}, numba {machine['numba']}, NumPy {machine['numpy']}, Gymnasium {machine['gymnasium']}).",
        "[All numbers](benchmarks/speed.json). gymnax returns to Python after each step, or with `lax.scan` after",
        f"{SCANNED} steps, whose observations and rewards it returns together.",
        *_peers(found.get("peers", {})),
        "",
        _table(found["environments"]),
    ]
    if "busy" in found:
        busy = found["busy"]
        lines += [f"\nThe same {beside(busy['processes'])}:\n", _table(busy["environments"])]
    if "training" in found:
        lines += ["", *_training(found)]
    if elsewhere:
        lines += ["", *_by_processor([found, *elsewhere])]
    return "\n".join(lines)


def _by_processor(results: Sequence[Mapping[str, Any]]) -> list[str]:
    """Return a table of ratios on one thread each, by CPU seconds, with the least of the processors."""
    rows = [result["environments"] for result in results]
    names = [name for name, row in rows[-1].items() if row["by"] == "turtlebot_gym" and 1 in (row["threads"], row["size"])]
    titles = [
        f"version {result['version']} ({result['commit'][:7]}), {processor(result['machine'])}, load "
        f"{result['machine']['load_before']:.0f}"
        for result in results
    ]
    lines = []
    for name in names:
        ratios = [row[name]["cpu_ratio"] if name in row else None for row in rows]
        cells = ["" if ratio is None else f"{ratio:.2f}" for ratio in ratios]
        least = min(ratio for ratio in ratios if ratio is not None)
        lines.append((name, *cells, f"{least:.2f}"))
    said = ["### By processor\n", "One thread beside CartPole's one, as ratios of CPU seconds:\n"]
    return [*said, markdown(("environment", *titles, "least"), lines)]


def _peers(peers: Mapping[str, Mapping[str, str]]) -> list[str]:
    """Return the versions of the peers, and which peer is missing."""
    sentences = []
    for name, versions in peers.items():
        if "missing" in versions:
            sentences.append(f"{name} took no part: {versions['missing'].rstrip('.')}.")
        else:
            listed = ", ".join(f"{package} {number}" for package, number in versions.items() if package not in ("numpy", name))
            sentences.append(f"{name} {versions[name]} ran in an environment of its own ({listed}).")
    return sentences


def _table(rows: Mapping[str, Mapping[str, Any]]) -> str:
    lines = []
    for name, row in rows.items():
        rates, by_cpu = (f"{row[rate]:,.0f}" for rate in ("steps_per_second", "steps_per_cpu_second"))
        by = LIBRARIES.get(row["by"], row["by"])
        lines.append((name, by, rates, f"{row['ratio']:.2f}", by_cpu, f"{row['cpu_ratio']:.2f}"))
    return markdown(("environment", "by", "steps/s", "ratio", "steps/CPU s", "ratio"), lines)


def _python(times: Mapping[str, float]) -> list[str]:
    """Return the sentence on what a step takes outside its compiled loops, by number of environments, if that was measured."""
    if not times:
        return []
    microseconds = ", ".join(f"{time:.1f}" for time in times.values())
    return [f"Outside its compiled loops a vector step of {', '.join(times)} environments takes {microseconds} microseconds."]


def _training(found: Mapping[str, Any]) -> list[str]:
    """Return the sentences on training."""
    trained, busy = found["training"], found.get("busy", {}).get("training")
    lines = [
        f"PPO learns from {trained['steps_per_second']:,.0f} steps/s over the vector environment,",
        f"{trained['ratio']:.1f} times as many as over Stable-Baselines3's `DummyVecEnv` of 64 scalar environments",
        f"({trained['dummy_vec_env']:,.0f} steps/s). The adapter `Sb3VecEnv` adds {found['adapter_ns']:.0f} ns to a step.",
        *_python(found.get("python_us", {})),
        f"A million steps take {trained['cpu_seconds_per_million']:.1f} CPU seconds",
    ]
    if not busy:
        return [*lines[:-1], f"{lines[-1]}."]
    more = busy["cpu_seconds_per_million"] / trained["cpu_seconds_per_million"]
    return [*lines, f"alone, and {busy['cpu_seconds_per_million']:.1f} beside the busy processes, {more:.2f} times as many."]
