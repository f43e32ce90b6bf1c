"""Notices: what was read otherwise than its author may expect, said in one line, as a warning that commands print as text."""

from __future__ import annotations

import warnings
from collections.abc import Iterable


class Notice(UserWarning):
    """Something that a file states and that was left out, or was read in a way that is worth saying."""


def notify(texts: Iterable[str]) -> None:
    """Warn once of each text, with the caller's caller as its place."""
    for text in texts:
        warnings.warn(text, Notice, stacklevel=3)
