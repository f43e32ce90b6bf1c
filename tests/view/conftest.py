"""Requirements of the viewer's tests: Bokeh, and Stable-Baselines3 for the view of a training."""

import importlib.util

collect_ignore = [] if importlib.util.find_spec("bokeh") else ["test_view.py", "test_watching.py"]
if not importlib.util.find_spec("stable_baselines3"):
    collect_ignore.append("test_watching.py")
