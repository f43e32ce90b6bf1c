"""How to install an extra of this package, from where the package itself came."""

from __future__ import annotations

import json
from importlib.metadata import PackageNotFoundError, distribution
from urllib.parse import unquote, urlsplit

DISTRIBUTION = "turtlebot-gym"


def installing(extra: str) -> str:
    """Return the command that installs an extra from the same checkout, wheel, address or index as the package.

    The name alone would ask an index, which need not know it, or knows another package by it.
    """
    try:
        noted = distribution(DISTRIBUTION).read_text("direct_url.json")
    except PackageNotFoundError:  # built by colcon, or found by its path
        return f"pip install '.[{extra}]' in a checkout"
    if noted is None:  # from an index
        return f"pip install '{DISTRIBUTION}[{extra}]'"
    origin = json.loads(noted)
    if origin.get("dir_info", {}).get("editable"):
        return f"pip install -e '{unquote(urlsplit(origin['url']).path)}[{extra}]'"
    vcs = f"{origin['vcs_info']['vcs']}+" if "vcs_info" in origin else ""
    return f"pip install '{DISTRIBUTION}[{extra}] @ {vcs}{origin['url']}'"
