"""Usage errors: one sentence, exit code 2, and the nearest valid name if there is one."""

from __future__ import annotations

import difflib
from collections.abc import Iterable


class UsageError(Exception):
    """The command line names something that does not exist or does not fit; the message is shown unchanged."""


def unknown(kind: str, name: str, valid: Iterable[str]) -> UsageError:
    """Build the usage error for an unknown name.

    "unknown stage 'mask_densfy'; did you mean 'mask_densify'? Valid: ..."
    """
    names = sorted(valid)
    close = difflib.get_close_matches(name, names, n=1, cutoff=0.4)
    hint = f"did you mean {close[0]!r}? " if close else ""
    shown = ", ".join(names[:40]) + (", ..." if len(names) > 40 else "")
    return UsageError(f"unknown {kind} {name!r}; {hint}Valid: {shown or 'none'}")
