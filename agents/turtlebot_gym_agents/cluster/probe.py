"""Inspect a cluster from a separate process, which can be abandoned; `access` runs this file.

Ray waits long for a cluster that does not answer, writes much text, and can end the calling process. So this process asks
first. It prints one line of JSON: the cluster's address, and each node's resources and the origin of its results.
"""

from __future__ import annotations

import json
import logging
import sys
from typing import Any


def look() -> dict[str, Any]:
    """Return the origin of results on the node that runs this; the function is sent there and uses nothing from here."""
    try:
        from turtlebot_gym_agents.cluster.origin import origin
    except ImportError as error:
        return {"missing": error.name or str(error)}
    return origin()


def main(address: str, seconds: float) -> None:
    """Inspect the cluster and print the answer."""
    import ray  # pyright: ignore[reportMissingImports]
    from ray.util.scheduling_strategies import NodeAffinitySchedulingStrategy  # pyright: ignore[reportMissingImports]

    ray.init(address=address, log_to_driver=False, logging_level=logging.CRITICAL)
    nodes = [node for node in ray.nodes() if node["Alive"] and node["Resources"].get("CPU", 0.0) > 0.0]
    task = ray.remote(look)
    asked = {
        task.options(
            num_cpus=0, max_retries=0, scheduling_strategy=NodeAffinitySchedulingStrategy(node["NodeID"], soft=False)
        ).remote(): node
        for node in nodes
    }
    told, _ = ray.wait(list(asked), num_returns=len(asked), timeout=seconds) if asked else ([], [])
    answers = {asked[each]["NodeID"]: ray.get(each) for each in told}
    found = [
        {
            "host": f"{node['NodeManagerHostname']} ({node['NodeManagerAddress']})",
            "cpus": node["Resources"]["CPU"],
            "memory": node["Resources"].get("memory", 0.0),
            "origin": answers.get(node["NodeID"]),
        }
        for node in nodes
    ]
    print(json.dumps({"address": ray.get_runtime_context().gcs_address, "nodes": found}), flush=True)


if __name__ == "__main__":
    del sys.path[0]  # this folder: its modules are not libraries
    main(sys.argv[1], float(sys.argv[2]))
