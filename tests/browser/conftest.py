"""What the tests in a browser need."""

import importlib.util

collect_ignore = [] if all(map(importlib.util.find_spec, ("bokeh", "playwright"))) else ["test_watch.py"]
