"""Shared by the tests in a browser."""

import importlib.util

NEEDS = {
    "test_field.py": ("playwright", "rclpy"),
    "test_site.py": ("mkdocs", "math_core", "playwright"),
    "test_watch.py": ("bokeh", "playwright"),
}
collect_ignore = [name for name, modules in NEEDS.items() if not all(map(importlib.util.find_spec, modules))]
