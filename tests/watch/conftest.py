"""What the tests of the viewer need: Bokeh, for what is drawn, and for that of a training Stable-Baselines3."""

import importlib.util

collect_ignore = [] if importlib.util.find_spec("bokeh") else ["test_view.py", "test_watching.py"]
if not importlib.util.find_spec("stable_baselines3"):
    collect_ignore.append("test_watching.py")
