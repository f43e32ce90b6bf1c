"""Requirements of the viewer's tests: Bokeh."""

import importlib.util

collect_ignore = [] if importlib.util.find_spec("bokeh") else ["test_view.py"]
