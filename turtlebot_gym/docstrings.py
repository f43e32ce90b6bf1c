"""The docstrings under the fields of classes of parameters, which help texts and ROS parameters show."""

from __future__ import annotations

import ast
import inspect
from itertools import pairwise
from textwrap import dedent


def texts_of(kind: type) -> dict[str, str]:
    """Return the docstring under each field of a dataclass and its bases, on one line; none where there is no source."""
    texts: dict[str, str] = {}
    for one in reversed(kind.__mro__[:-1]):
        try:
            (made,) = ast.parse(dedent(inspect.getsource(one))).body
        except (OSError, TypeError, SyntaxError):  # TypeError: of a module without a file
            continue
        for item, text in pairwise(getattr(made, "body", ())):
            if isinstance(item, ast.AnnAssign) and isinstance(text, ast.Expr) and isinstance(text.value, ast.Constant):
                texts[ast.unparse(item.target)] = " ".join(str(text.value.value).split())
    return texts
