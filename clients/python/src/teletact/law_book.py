"""The contact law as one touch stream has been told it: lanes of columns, of the versions that rule there."""

from __future__ import annotations

import bisect
from dataclasses import replace

import numpy as np

from teletact.errors import BadAnswer
from teletact.law import Law, LawColumn
from teletact.v1 import palpation_pb2 as palpation

_MOST_ROWS = 24
_MOST_IN_PIECE = 64
_MOST_COLUMNS = 16384
_FARTHEST_M = 10.0
_OF_A_PLANE, _OF_AN_AREA = 4, 8


def _columns_from(piece: palpation.LawPiece) -> list[LawColumn] | None:
    """None where it is malformed."""
    if not 1 <= len(piece.columns) <= _MOST_IN_PIECE:
        return None
    out: list[LawColumn] = []
    for received in piece.columns:
        rows = len(received.log_indentation)
        if not 1 <= rows <= _MOST_ROWS or len(received.samples) not in (_OF_A_PLANE * rows, _OF_AN_AREA * rows):
            return None
        given = np.array(received.samples).reshape(rows, -1)
        samples = np.zeros((rows, _OF_AN_AREA))
        samples[:, :given.shape[1]] = given
        share = received.of_force_error if received.of_force_error != 0 else 1.0
        single = np.float32(share)
        column = LawColumn(
            received.x_m, piece.z_m, piece.lane_before_m, piece.model_version,
            float(single * np.float32(piece.force_error_share)), float(single * np.float32(piece.force_error_n)),
            given.shape[1] == _OF_AN_AREA, not piece.guess, np.array(received.log_indentation), samples)
        if not _usable(column) or (out and not out[-1].x_m < column.x_m):
            return None
        out.append(column)
    return out


def _usable(column: LawColumn) -> bool:
    """Whether it may be evaluated: finite, rows increasing, the energy growing with depth in every sample."""
    places = (column.x_m, column.z_m, column.lane_before_m)
    if not all(abs(place) <= _FARTHEST_M for place in places) or not column.lane_before_m <= column.z_m:
        return False
    if not (0 <= column.error_share <= 1 and 0 <= column.error_n < np.inf):
        return False
    if not np.isfinite(column.samples).all() or not np.isfinite(column.log_depth).all():
        return False
    if not (column.samples[:, 2] > 0).all():
        return False
    return bool((np.diff(column.log_depth) > 0).all() and (np.diff(column.samples[:, 0]) > 0).all())


class _Lane:
    """Columns of one z, by x."""

    def __init__(self) -> None:
        self.x: list[float] = []
        self.columns: list[LawColumn] = []

    def between(self, begin_m: float, end_m: float) -> range:
        return range(bisect.bisect_left(self.x, begin_m), bisect.bisect_right(self.x, end_m))

    def set(self, column: LawColumn) -> None:
        at = bisect.bisect_left(self.x, column.x_m)
        if at < len(self.x) and self.x[at] == column.x_m:
            self.columns[at] = column
        else:
            self.x.insert(at, column.x_m)
            self.columns.insert(at, column)

    def drop_older(self, begin_m: float, end_m: float, version: int) -> None:
        inside = self.between(begin_m, end_m)
        kept = [column for column in self.columns[inside.start:inside.stop] if column.version >= version]
        self.columns[inside.start:inside.stop] = kept
        self.x[inside.start:inside.stop] = [column.x_m for column in kept]


class LawBook:
    """Takes the pieces of one stream. The same rules as ``client/link/law_book.h``."""

    def __init__(self, layer_depth_m: float = 0.0) -> None:
        self._layer_depth_m = layer_depth_m
        self._lanes: dict[float, _Lane] = {}
        self._law: Law | None = None
        self.pieces = 0  # that have come

    def take(self, piece: palpation.LawPiece, call: str = "Touch") -> None:
        """Raises BadAnswer for a piece that is malformed, or not the next: nothing that is known changes."""
        if piece.piece != self.pieces + 1:
            raise BadAnswer(f"{piece.piece} after {self.pieces}", field="law.piece", call=call)
        columns = _columns_from(piece)
        if columns is None or not (piece.begin_x_m <= columns[0].x_m and piece.end_x_m >= columns[-1].x_m):
            raise BadAnswer("a malformed piece of a contact law", field="law.columns", call=call)
        if sum(len(lane.x) for lane in self._lanes.values()) + len(columns) > _MOST_COLUMNS:
            raise BadAnswer(f"more than {_MOST_COLUMNS} columns", field="law.columns", call=call)
        self.pieces += 1
        self._law = None
        lane = self._lanes.setdefault(piece.z_m, _Lane())
        # The span's first column may stand amid an older law: that cell was whole, and still is.
        split = bisect.bisect_left(lane.x, piece.begin_x_m)
        joined_before = 0 < split < len(lane.x) and lane.columns[split].joined
        lane.drop_older(piece.begin_x_m, piece.end_x_m, piece.model_version)
        for column in columns:
            right = bisect.bisect_left(lane.x, column.x_m)
            if right < len(lane.x) and lane.x[right] == column.x_m:
                ours = lane.columns[right].version <= column.version
            elif 0 < right < len(lane.x) and lane.columns[right].joined:  # not amid what is newer
                ours = min(lane.columns[right].version, lane.columns[right - 1].version) <= column.version
            else:
                ours = True
            if ours:
                lane.set(column)
        for at in lane.between(piece.begin_x_m, piece.end_x_m):
            joined = lane.x[at] > piece.begin_x_m or joined_before
            lane.columns[at] = replace(lane.columns[at], joined=joined)
        if not lane.x:
            del self._lanes[piece.z_m]

    def law(self) -> Law:
        """What is known by now."""
        if self._law is None:
            columns = [column for lane in self._lanes.values() for column in lane.columns]
            self._law = Law(columns, self._layer_depth_m)
        return self._law
