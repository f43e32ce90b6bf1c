"""What the tests of the viewer need: Bokeh, for what is drawn."""

import importlib.util

collect_ignore = [] if importlib.util.find_spec("bokeh") else ["test_view.py"]
