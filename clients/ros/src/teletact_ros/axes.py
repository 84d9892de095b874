"""How an arm stands to the scene."""

from __future__ import annotations

import numpy as np
from teletact.arrays import Floats


class Axes:
    """``words``: which of the arm's axes moves the finger along the scene's x, y and z, such as "z,y,-x" (y goes into
    the tissue). ``origin_m``: where in the scene the arm's zero lies."""

    def __init__(self, words: str, origin_m: list[float]) -> None:
        self._turn = np.zeros((3, 3))
        for row, word in enumerate(words.split(",")):
            axis = word.strip().removeprefix("-")
            if row > 2 or axis not in ("x", "y", "z"):
                break
            self._turn[row, "xyz".index(axis)] = -1.0 if word.strip().startswith("-") else 1.0
        if not np.array_equal(self._turn @ self._turn.T, np.eye(3)) or words.count(",") != 2:
            raise ValueError(f"axes: {words!r}; give each of x, y and z once, such as x,-z,y")
        if np.linalg.det(self._turn) < 0:
            raise ValueError(f"axes: {words!r} is a mirror image, in which right is left; turn the sign of one of them")
        self._origin = np.array(origin_m, np.float64)
        if self._origin.shape != (3,) or not np.isfinite(self._origin).all():
            raise ValueError(f"origin_m: {origin_m}; give x, y and z in metres")

    def to_scene(self, position_m: Floats) -> Floats:
        return np.asarray(self._origin + self._turn @ position_m)

    def to_arm(self, force_n: Floats) -> Floats:
        return np.asarray(self._turn.T @ force_n)
