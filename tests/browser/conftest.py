"""Shared by the tests in a browser."""

import importlib.util

NEEDS = {"test_watch.py": ("bokeh", "playwright"), "test_site.py": ("mkdocs", "math_core", "playwright")}
collect_ignore = [name for name, modules in NEEDS.items() if not all(map(importlib.util.find_spec, modules))]
