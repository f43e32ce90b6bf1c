"""The study's findings in sentences, losses of learning first, for README and documentation."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

VERDICTS = {
    "PPO slower": "PPO is slower than the tuned baseline in {n} of {all} scenarios",
    "no difference found": "No difference is found in {n}",
    "PPO faster": "PPO is faster in {n}",
}

LISTED = 4
"""Most scenarios listed one by one; of more, only the two ends are listed, and the tables of the documentation have the
rest."""


def summary(results: Mapping[str, Any]) -> list[str]:
    """Return the study's findings as Markdown bullets, from the results of `robustness.py`."""
    rows = results["comparisons"]
    return [
        *_verdicts(rows),
        *_untuned(rows),
        *_filter(rows),
        *_false_arrivals(results["false_arrivals"], results["config"]),
    ]


def headline(results: Mapping[str, Any]) -> str:
    """Return how often PPO loses, draws and wins: the findings' first words, without the numbers of each scenario."""
    rows = results["comparisons"]
    return " ".join(f"{bullet.split('**')[1]}." for bullet in (*_verdicts(rows), *_untuned(rows)))


def conditions(results: Mapping[str, Any]) -> str:
    """Describe how the figures were made."""
    config, n = results["config"], len(results["comparisons"])
    return (
        f"Each scenario has {config['seeds']} trainings (seeds 0 to {config['seeds'] - 1}) and {config['episodes']} paired "
        f"episodes (seeds from {config['first_seed']:,}). Each baseline is tuned for its scenario, in {config['tries']} tries "
        f"of {config['episodes']} episodes on other seeds. Intervals are 95 %, over trainings and episodes. A difference is "
        f"one whose p-value is below 0.05 after Holm's correction for {n} scenario{'s' * (n > 1)}."
    )


def _verdicts(rows: Sequence[Mapping[str, Any]]) -> list[str]:
    bullets = []
    for verdict, words in VERDICTS.items():
        chosen = sorted((row for row in rows if row["verdict"] == verdict), key=lambda row: row["ppo"]["difference"]["value"])
        if chosen:
            listed = _listed([f"{row['scenario']} ({_difference(row)})" for row in chosen])
            bullets.append(f"* **{words.format(n=len(chosen), all=len(rows))}**: {listed}.")
    return bullets


def _listed(items: Sequence[str]) -> str:
    """Return a sorted list as text, complete or only its two ends."""
    return "; ".join(items) if len(items) <= LISTED else f"from {items[0]} to {items[-1]}"


def _difference(row: Mapping[str, Any]) -> str:
    difference = row["ppo"]["difference"]
    times = f"{row['ppo']['time']['value']:.2f} s to {row['baselines'][0]['time']['value']:.2f} s"
    return f"{times}: {difference['value']:+.2f} s, {difference['low']:+.2f} to {difference['high']:+.2f}"


def _untuned(rows: Sequence[Mapping[str, Any]]) -> list[str]:
    """Return the result of the same comparison with untuned baselines."""
    gains = {
        row["scenario"]: (row["baselines"][0]["time_untuned"]["value"], row["baselines"][0]["time"]["value"])
        for row in rows
        if row["ppo"]["time"]["value"] < row["baselines"][0]["time_untuned"]["value"] and row["verdict"] != "PPO faster"
    }
    if not gains:
        return []
    ordered = sorted(gains.items(), key=lambda item: item[1][0] - item[1][1])
    listed = _listed([f"{name} ({untuned:.2f} s instead of {tuned:.2f} s)" for name, (untuned, tuned) in ordered])
    return [f"* **Against the baselines' defaults PPO would have won {len(gains)} more**: {listed}."]


def _filter(rows: Sequence[Mapping[str, Any]]) -> list[str]:
    """Return the filter's gain for either policy, for each noise with both results."""
    by_name = {row["scenario"]: row for row in rows}
    parts = []
    for noise in ("tutorial", "documented", "rough", "wheel"):
        both = [by_name.get(f"Nav, {seen}, {noise}") for seen in ("raw odometry", "estimate")]
        if all(both):
            geometry = " to ".join(f"{row['baselines'][0]['time']['value']:.2f} s" for row in both if row)
            ppo = " to ".join(f"{row['ppo']['time']['value']:.2f} s" for row in both if row)
            parts.append(f"`{noise}` {geometry} for geometry, {ppo} for PPO")
    return [f"* **What the filter buys**, from raw odometry to its estimate: {'; '.join(parts)}."] if parts else []


def _false_arrivals(rows: Sequence[Mapping[str, Any]], config: Mapping[str, Any]) -> list[str]:
    shares = ", ".join(
        f"{100.0 * row['false_arrival']['value']:.1f} % ({100.0 * row['false_arrival']['low']:.1f} to "
        f"{100.0 * row['false_arrival']['high']:.1f}) under `{row['noise']}`"
        for row in rows
    )
    return [
        f"* **Where the episode ends on belief**, which must be inside by a margin, the robot is not within 0.15 m in {shares} "
        f"(the bearing law, {config['episodes']} episodes each)."
    ]
