"""The contact law of a fingertip on a layer (docs/theory.md, T7), evaluated for many poses at once.

W = ln U is interpolated, U the energy of the contact: over s = ln d in columns, d the indentation; over x between
columns; and, of a solid, over z between lanes of columns. The force is F = -grad U. It is the interpolation of
``common/contact_law.h``, with which a haptic device feels the tissue.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Sequence

import numpy as np
import numpy.typing as npt

from teletact import arrays
from teletact.arrays import Floats

_BLOCK = 8192  # poses that are evaluated together: their numbers stay in the processor's cache
_FEW = 64      # places among which counting is faster than searching
_FAR = 64.0    # between the keys of two lanes; more than twice the farthest x in metres

Ints = npt.NDArray[np.int64]
Flags = npt.NDArray[np.bool_]


@dataclass(frozen=True)
class LawColumn:
    """Samples at one place. ``samples``: (rows, 8) of W, W_x, W_s, W_xs, W_z, W_zs, W_xz, W_xzs."""

    x_m: float
    z_m: float
    lane_before_m: float  # z of the lane before its own, where none is missing between; else its own
    version: int
    error_share: float
    error_n: float
    of_area: bool    # of a solid: its lane holds at its z alone
    corrected: bool  # False: a guess
    log_depth: Floats
    samples: Floats
    joined: bool = True  # no column is missing between the one before it in its lane and this one


@dataclass(frozen=True)
class LawValues:
    """What a law says at n poses. All are NaN, False or 0 where it says nothing."""

    energy_j: Floats   # (n,) >= 0
    force_n: Floats    # (n, 3), on the finger
    error_n: Floats    # (n,) what the force may be off by
    known: Flags       # (n,)
    beyond: Flags      # deeper than a column's last sample: the power law goes on
    corrected: Flags   # no guess is in it
    oldest_version: Ints
    newest_version: Ints


def _coefficients(column: LawColumn) -> Floats:
    """Of each interval of ln d, the first and last open: (rows + 1, 4 curves, 4 powers of s less its origin)."""
    value, slope = column.samples[:, [0, 1, 4, 6]], column.samples[:, [2, 3, 5, 7]]
    out = np.zeros((len(value) + 1, 4, 4))
    out[0, :, 0], out[0, :, 1] = value[0], slope[0]
    out[1:, :, 0], out[1:, :, 1] = value, slope
    width = np.diff(column.log_depth)[:, None]
    mean = np.diff(value, axis=0) / width
    out[1:-1, :, 2] = (3 * mean - 2 * slope[:-1] - slope[1:]) / width
    out[1:-1, :, 3] = (slope[:-1] + slope[1:] - 2 * mean) / (width * width)
    return out


def _hermite(value_0: Floats, slope_0: Floats, value_1: Floats, slope_1: Floats, width: Floats,
             t: Floats) -> tuple[Floats, Floats]:
    """The cubic with these values and slopes at the ends of [0, width], at share t of it, and its slope."""
    rise = value_1 - value_0
    a = width * slope_0 - rise
    b = rise - width * slope_1
    u = 1 - t
    bend = u * a + t * b
    tu = t * u
    return value_0 + t * rise + tu * bend, (rise + (u - t) * bend + tu * (b - a)) / width


def _count(places: Floats, x: Floats) -> Ints:
    """How many of the increasing places are at or before each x."""
    if len(places) > _FEW:
        return np.searchsorted(places, x, side="right")
    out = np.zeros(len(x), np.int64)
    for place in places:
        out += place <= x
    return out


class Law:
    """What is known of a contact law: columns by lane and place. It never changes."""

    def __init__(self, columns: Sequence[LawColumn], layer_depth_m: float = 0.0) -> None:
        self.columns: tuple[LawColumn, ...] = tuple(sorted(columns, key=lambda column: (column.z_m, column.x_m)))
        self.layer_depth_m = layer_depth_m
        held = self.columns
        self._x = np.array([column.x_m for column in held])
        self._error_share = np.array([column.error_share for column in held])
        self._error_n = np.array([column.error_n for column in held])
        self._joined = np.array([column.joined for column in held], bool)
        self._corrected = np.array([column.corrected for column in held], bool)
        self._version = np.array([column.version for column in held], np.int64)
        self._lane_before = np.array([column.lane_before_m for column in held])
        z_m = np.array([column.z_m for column in held])
        self._lane_z, self._lane_begin = np.unique(z_m, return_index=True)
        self._lane_end = np.append(self._lane_begin[1:], len(held))
        self._of_area = bool(held) and held[0].of_area
        rows = np.array([len(column.log_depth) for column in held], np.int64)
        self._first_interval = np.cumsum(np.append(0, rows + 1))[:-1].astype(np.int64)
        self._rows = rows
        self._alike = len(set(self._version)) < 2 and len(set(self._corrected)) < 2  # nothing meets anywhere
        if not held:
            return
        lane = np.repeat(np.arange(len(self._lane_z)), self._lane_end - self._lane_begin)
        self._x_keys = lane * _FAR + self._x
        # By row, then column: ln d as C++ has it, single precision; none is beyond every pose.
        self._knots = np.full((rows.max(), len(held)), np.inf)
        for index, column in enumerate(held):
            self._knots[:rows[index], index] = column.log_depth
        # Of each interval: where s is counted from, then the coefficients.
        self._origin = np.concatenate([np.append(column.log_depth[0], column.log_depth) for column in held])
        curves = 4 if self._of_area else 2
        powers = np.concatenate([_coefficients(column)[:, :curves] for column in held]).reshape(-1, 4 * curves)
        self._powers = np.ascontiguousarray(powers.T)

    @property
    def extent_x_m(self) -> tuple[float, float]:
        """From the first to the last column; NaN of none. Between them there may be gaps."""
        return (float(self._x.min()), float(self._x.max())) if self.columns else (np.nan, np.nan)

    def __call__(self, positions_m: Any) -> LawValues:
        """At positions [x, y, z] of the finger in the scene, shape (n, 2) or (n, 3); y is depth, below the layer."""
        given = arrays.vectors(positions_m, "positions_m")
        return self.evaluate(given[:, 0], given[:, 1] - self.layer_depth_m, given[:, 2])

    def evaluate(self, x_m: Any, indentation_m: Any, z_m: Any = 0.0) -> LawValues:
        """At places along the layer and indentations, of shapes that fit together; 0 or less: no contact, no force."""
        x, d, z = (np.ascontiguousarray(a).ravel() for a in np.broadcast_arrays(
            *(np.asarray(values, np.float64) for values in (x_m, indentation_m, z_m))))
        n = len(x)
        out = LawValues(np.full(n, np.nan), np.full((n, 3), np.nan), np.full(n, np.nan), np.zeros(n, bool),
                        np.zeros(n, bool), np.zeros(n, bool), np.zeros(n, np.int64), np.zeros(n, np.int64))
        if self.columns:
            for begin in range(0, n, _BLOCK):
                part = slice(begin, begin + _BLOCK)
                with np.errstate(over="ignore", invalid="ignore", divide="ignore"):  # overflow: nothing is known
                    self._evaluate(x[part], d[part], z[part], out, begin)
        return out

    def _cells(self, x: Floats, z: Floats) -> tuple[Flags, list[Ints]]:
        """Where there is a cell, and the left one of its two columns in each of its lanes."""
        lanes = len(self._lane_z)
        if not self._of_area:
            if lanes != 1:
                return np.zeros(len(x), bool), []
            lane = np.zeros(len(x), np.int64)
            known, left = self._left_of(lane, x)
            return known & ~np.isnan(z), [left]
        if lanes < 2:
            return np.zeros(len(x), bool), []
        after = np.searchsorted(self._lane_z, z, side="right")
        inside = (z >= self._lane_z[0]) & (z <= self._lane_z[-1])
        after = np.clip(after, 1, lanes - 1)
        known_before, left_before = self._left_of(after - 1, x)
        known_after, left_after = self._left_of(after, x)
        z_before = self._lane_z[after - 1]
        joined = (self._lane_before[left_after] == z_before) & (self._lane_before[left_after + 1] == z_before)
        return inside & known_before & known_after & joined, [left_before, left_after]

    def _left_of(self, lane: Ints, x: Floats) -> tuple[Flags, Ints]:
        """Whether two columns of a lane are around x, none missing between; the left one, or any where not."""
        begin, end = self._lane_begin[lane], self._lane_end[lane]
        if len(self._lane_z) == 1:
            right = _count(self._x, x)
        else:
            right = np.searchsorted(self._x_keys, lane * _FAR + np.clip(x, -_FAR / 4, _FAR / 4), side="right")
        right = np.clip(right, begin + 1, np.maximum(end - 1, begin + 1))
        two = end - begin >= 2
        right = np.minimum(right, len(self._x) - 1)
        known = two & (x >= self._x[begin]) & (x <= self._x[end - 1]) & self._joined[right]
        return known, np.maximum(right - 1, 0)

    def _curves(self, column: Ints, s: Floats) -> tuple[list[tuple[Floats, Floats]], Flags]:
        """Of one column of each pose, by s: value and slope of W, W_x (and W_z, W_xz), and whether it is beyond."""
        single = s.astype(np.float32)
        interval = self._first_interval[column]
        first = interval.copy()
        for knots in self._knots:
            interval += knots[column] <= single
        t = s - self._origin[interval]
        out = []
        for k in range(0, len(self._powers), 4):
            c_0, c_1, c_2, c_3 = (power[interval] for power in self._powers[k:k + 4])
            c_3 *= t
            inner = c_2 + c_3
            middle = c_1 + t * inner
            out.append((c_0 + t * middle, middle + t * (inner + c_3)))
        return out, (interval - first == self._rows[column]) & (t > 0)

    def _evaluate(self, x: Floats, d: Floats, z: Floats, out: LawValues, begin: int) -> None:
        known, lefts = self._cells(x, z)
        known = known & ~np.isnan(d)
        if not known.any():
            return
        at = np.flatnonzero(known)
        if len(at) < len(x):
            x, d, z, lefts = x[at], d[at], z[at], [left[at] for left in lefts]
        columns = [side for left in lefts for side in (left, left + 1)]
        touched = d > 0
        s = np.log(np.where(touched, d, 1.0))
        curves, beyond = zip(*(self._curves(column, s) for column in columns))
        w, by_x, by_s, by_z = self._between(columns, list(curves), x, z)
        energy = np.exp(w)
        resistance = [energy * by_x, energy * by_s / d] + ([] if by_z is None else [energy * by_z])
        size = np.sqrt(sum(component * component for component in resistance))
        if self._alike:
            oldest = newest = np.broadcast_to(self._version[:1], x.shape)
            every = np.broadcast_to(self._corrected[:1], x.shape)
        else:
            versions = [self._version[column] for column in columns]
            oldest, newest = np.minimum.reduce(versions), np.maximum.reduce(versions)
            corrected = [self._corrected[column] for column in columns]
            every = np.logical_and.reduce(corrected)
        error = np.maximum.reduce([self._error_share[column] for column in columns]) * size
        error += np.maximum.reduce([self._error_n[column] for column in columns])
        if not self._alike:
            meet = (oldest != newest) | (np.logical_or.reduce(corrected) & ~every)
            error += np.where(meet, self._disagreement(columns, list(curves), x, d, z, resistance), 0)
        sure = np.isfinite(energy + sum(resistance) + error)
        if not touched.all():
            for values in (energy, error, *resistance):
                values[~touched] = 0.0
            sure |= ~touched
        # One block after another as a rule: a slice, where nothing is left out.
        into: Any = slice(begin, begin + len(at))
        keep: Any = slice(None)
        if not (sure.all() and at[-1] == len(at) - 1):
            into, keep = begin + at[sure], sure
        out.energy_j[into], out.error_n[into] = energy[keep], error[keep]
        out.force_n[into, 2] = 0.0
        for axis, values in enumerate(resistance):  # the slopes of the energy with their signs turned, and no -0
            out.force_n[into, axis] = 0.0 - values[keep]
        out.known[into] = True
        out.beyond[into] = (np.logical_or.reduce(beyond) & touched)[keep]
        out.corrected[into] = every[keep]
        out.oldest_version[into], out.newest_version[into] = oldest[keep], newest[keep]

    def _between(self, columns: list[Ints], curves: list[list[tuple[Floats, Floats]]], x: Floats,
                 z: Floats) -> tuple[Floats, Floats, Floats, Floats | None]:
        """W and its slopes along x, s and, of a solid, z, between the columns of each pose."""
        lanes = []
        for k in range(0, len(columns), 2):
            a, b = curves[k], curves[k + 1]
            from_x = self._x[columns[k]]
            width = self._x[columns[k + 1]] - from_x
            t = (x - from_x) / width
            w, by_x = _hermite(a[0][0], a[1][0], b[0][0], b[1][0], width, t)
            by_s, _ = _hermite(a[0][1], a[1][1], b[0][1], b[1][1], width, t)
            if len(columns) == 2:
                return w, by_x, by_s, None
            by_z, by_xz = _hermite(a[2][0], a[3][0], b[2][0], b[3][0], width, t)
            by_zs, _ = _hermite(a[2][1], a[3][1], b[2][1], b[3][1], width, t)
            lanes.append((w, by_x, by_s, by_z, by_xz, by_zs))
        before, after = lanes
        from_z = self._z_of(columns[0])
        width = self._z_of(columns[2]) - from_z
        t = (z - from_z) / width
        w, by_z = _hermite(before[0], before[3], after[0], after[3], width, t)
        by_x, _ = _hermite(before[1], before[4], after[1], after[4], width, t)
        by_s, _ = _hermite(before[2], before[5], after[2], after[5], width, t)
        return w, by_x, by_s, by_z

    def _z_of(self, column: Ints) -> Floats:
        out: Floats = self._lane_z[np.searchsorted(self._lane_begin, column, side="right") - 1]
        return out

    def _disagreement(self, columns: list[Ints], curves: list[list[tuple[Floats, Floats]]], x: Floats, d: Floats,
                      z: Floats, resistance: list[Floats]) -> Floats:
        """How far the force is from that of any of the columns alone, carried on to the pose."""
        most = np.zeros(len(x))
        for column, own in zip(columns, curves):
            off_x = x - self._x[column]
            w, by_x, by_s = own[0][0] + off_x * own[1][0], own[1][0], own[0][1] + off_x * own[1][1]
            alone = [by_x, by_s]
            if len(columns) == 4:
                off_z = z - self._z_of(column)
                w, alone = w + off_z * own[2][0], [by_x, by_s + off_z * own[2][1], own[2][0]]
            energy = np.exp(w)
            alone = [energy * slope for slope in alone]
            alone[1] = alone[1] / d
            apart = sum((ours - theirs) ** 2 for ours, theirs in zip(resistance, alone))
            most = np.maximum(most, np.sqrt(apart))
        return most
