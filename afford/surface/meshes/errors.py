"""What is said of a mesh that cannot be used, before it is known which file it came from."""

from __future__ import annotations


class MeshError(ValueError):
    """What was expected of a mesh, what was got, what to do."""

    def __init__(self, expected: str, got: str, fix: str) -> None:
        super().__init__(f"expected {expected}, got {got}; {fix}")
        self.expected, self.got, self.fix = expected, got, fix
