"""Shared by the tests in a browser."""

import importlib.util

collect_ignore = [] if all(map(importlib.util.find_spec, ("bokeh", "playwright"))) else ["test_watch.py"]
