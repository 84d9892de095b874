"""Recordings of teletact-client (``touch --record``, ``acquire --record``) as DataFrames."""

from __future__ import annotations

import math
from array import array
from collections import defaultdict
from dataclasses import dataclass, field
from itertools import chain, repeat
from pathlib import Path
from typing import Any, BinaryIO, Iterator

import numpy as np
import pandas as pd

from teletact.answers import PATH_NAMES, STATUSES
from teletact.errors import BadAnswer, DamagedFile
from teletact.law import Law
from teletact.law_book import LawBook
from teletact.v1 import palpation_pb2 as palpation
from teletact.v1 import recording_pb2 as recording

_VERSION = 2
_MOST_ENTRY_BYTES = 1 << 30
_VECTORS = {  # fields of several components: the names of their columns, and what stands for one that is missing
    "position_m": (("x_m", "y_m", "z_m"), 0.0),
    "origin_m": (("x_m", "y_m", "z_m"), 0.0),
    "velocity_m_s": (("velocity_x_m_s", "velocity_y_m_s", "velocity_z_m_s"), 0.0),
    "force_n": (("force_x_n", "force_y_n", "force_z_n"), 0.0),
    "lateral_stiffness_n_m": (("lateral_stiffness_x_n_m", "lateral_stiffness_z_n_m"), math.nan),
    "lateral_stiffness_variance": (("lateral_stiffness_variance_x", "lateral_stiffness_variance_z"), math.nan)}
_SERVO = [(field.name, field.name in _VECTORS, field.has_presence) for field in recording.ServoSample.DESCRIPTOR.fields]
_COMPACT = {float: ("d", math.nan), int: ("q", -1), bool: ("b", -1)}  # array's type, and what stands for None


@dataclass
class Recording:
    """What was recorded. Every table's index is ``time_s`` since the first entry, by the recorder's clock.

    Names of columns end in their units. ``servo``: one row for each tick. ``state``: 0 DISABLED, 1 ENABLED, 2 PAUSED,
    3 FAULT. ``reason`` of it: 0 start, 1 resumed, 2 silence, 3 paused, 4 disabled, 5 device lost, 6 not finite, 7 too
    fast, 8 frozen. ``withheld``: share of the force. ``claim`` that was refused: 0 none, 1 silence, 2 age, 3 clutch,
    4 ramp, 5 harder answer, 6 model, 7 contact law, 8 a law's border. ``poses`` and ``answers`` of the touch
    streams, ``call`` counts these; ``windows``: of an ``acquire``, times as the index; ``estimates``: their summaries.
    ``laws``: the contact law of each touch stream as it stood at its end, by ``call``; none where one was malformed.
    ``cut_short``: the writer was killed in its last entry. Tables of what was not recorded are empty.
    """

    kind: str
    scene_id: str
    service: str
    client: str
    unix_time_s: int
    arguments: tuple[str, ...]
    servo: pd.DataFrame = field(default_factory=pd.DataFrame)
    poses: pd.DataFrame = field(default_factory=pd.DataFrame)
    answers: pd.DataFrame = field(default_factory=pd.DataFrame)
    windows: pd.DataFrame = field(default_factory=pd.DataFrame)
    estimates: pd.DataFrame = field(default_factory=pd.DataFrame)
    laws: dict[int, Law] = field(default_factory=dict)
    cut_short: bool = False


def entries(path: str | Path) -> Iterator[recording.RecordEntry | None]:
    """The messages of a file, its header first; None last where the end is cut short. Raises DamagedFile."""
    try:
        file = open(path, "rb")
    except OSError as error:
        raise DamagedFile(f"the recording '{path}' cannot be read ({error.strerror})",
                          remedy="give another file") from None
    with file:
        yield from entries_of(file, path)


def entries_of(file: BinaryIO, path: str | Path) -> Iterator[recording.RecordEntry | None]:
    """The same of an open file, or of one that is still written. ``path``: for messages."""
    damaged = DamagedFile(f"the recording '{path}' is damaged", remedy="record it again")
    while True:
        size = shift = 0
        while True:
            byte = file.read(1)
            if not byte:
                if shift:
                    yield None
                return
            size |= (byte[0] & 0x7F) << shift
            shift += 7
            if byte[0] < 0x80:
                break
            if shift > 28:
                raise damaged
        if size > _MOST_ENTRY_BYTES:
            raise damaged
        body = file.read(size)
        if len(body) < size:
            yield None
            return
        try:
            yield recording.RecordEntry.FromString(body)
        except Exception:  # protobuf's own, of a package that differs between its implementations
            raise damaged from None


def read_recording(path: str | Path) -> Recording:
    """The whole of it, in memory: about 250 bytes for each tick of the servo, 150 MB for ten minutes of 1 kHz.

    Raises DamagedFile where it is none, of another version, or damaged."""
    messages = entries(path)
    try:
        first = next(messages, None)
    except DamagedFile as error:
        raise (_no_recording(path) if "damaged" in error.problem else error) from None
    header = check_header(first, path)
    out = Recording(header.kind, header.scene_id, header.service, header.client, header.unix_time_s,
                    tuple(header.arguments))
    tables: dict[str, dict[str, _Column]] = {name: defaultdict(_Column) for name in (
        "servo", "poses", "answers", "windows", "estimates")}
    books: dict[int, LawBook] = {}
    begin_ns: int | None = None
    for entry in messages:
        if entry is None:
            out.cut_short = True
            break
        if begin_ns is None and entry.monotonic_ns:
            begin_ns = entry.monotonic_ns
        time_s = 1e-9 * (entry.monotonic_ns - (begin_ns or 0))
        for name, row in _rows_of(entry, begin_ns or 0):
            columns = tables[name]
            columns["time_s"].add(time_s)
            if name != "servo":
                columns["call"].add(entry.call)
            for column, value in row.items():
                columns[column].add(value)
        if entry.HasField("touch_response"):
            _take_law(entry, books)
    for name, columns in tables.items():
        if columns:
            index = pd.Index(columns.pop("time_s").values(), name="time_s")
            setattr(out, name, pd.DataFrame({column: of.values() for column, of in columns.items()}, index, copy=False))
    out.laws = {call: book.law() for call, book in books.items() if book.pieces}
    return out


class _Column:
    """Values of one type as they come: 8 bytes for a number, 1 for a truth value. None: not recorded."""

    def __init__(self) -> None:
        self._values: Any = None  # once one was recorded
        self._gap: Any = None     # what stands for None among them
        self._gaps = 0

    def add(self, value: Any) -> None:
        if value is None:
            self._gaps += 1
            if self._values is not None:
                self._values.append(self._gap)
            return
        if self._values is None:
            code, self._gap = _COMPACT.get(type(value), ("", None))
            self._values = (array(code, [self._gap]) if code else [None]) * self._gaps
        try:
            self._values.append(value)
        except OverflowError:  # above what int64 holds
            self._values = [*self._values, value]

    def values(self) -> Any:
        """As pandas would make them of a list: with gaps numbers are floats, truth values objects."""
        if self._values is None:
            return [None] * self._gaps
        if isinstance(self._values, list):
            return self._values
        values = np.frombuffer(self._values, self._values.typecode)
        if values.dtype == np.int8:
            return np.where(values < 0, np.array(None), values.view(bool)) if self._gaps else values.view(bool)
        if values.dtype == np.int64 and self._gaps:
            return np.where(values < 0, np.nan, values)
        return values


def _no_recording(path: str | Path) -> DamagedFile:
    return DamagedFile(f"'{path}' is not a teletact-client recording",
                       remedy="give a file of touch or acquire --record")


def check_header(first: recording.RecordEntry | None, path: str | Path) -> recording.RecordHeader:
    """That of the first entry. Raises DamagedFile where it is none, or of another version."""
    if first is None or not first.HasField("header"):
        raise _no_recording(path)
    if first.header.version != _VERSION:
        raise DamagedFile(f"the recording '{path}' is of version {first.header.version}, and version {_VERSION} is read",
                          remedy="record it again")
    return first.header


def _take_law(entry: recording.RecordEntry, books: dict[int, LawBook]) -> None:
    response = entry.touch_response
    if response.HasField("opened"):
        books[entry.call] = LawBook(response.opened.layer.depth_m)
    elif response.HasField("law") and entry.call in books:
        try:
            books[entry.call].take(response.law)
        except BadAnswer:  # of that stream none is told
            del books[entry.call]


def _rows_of(entry: recording.RecordEntry, begin_ns: int) -> Iterator[tuple[str, dict[str, Any]]]:
    kind = entry.WhichOneof("kind")
    if kind == "servo":
        yield "servo", _servo_row(entry.servo)
    elif kind == "touch_request" and entry.touch_request.HasField("pose"):
        pose = entry.touch_request.pose
        yield "poses", {"sequence": pose.sequence, **_vector(pose, "position_m"), **_vector(pose, "velocity_m_s")}
    elif kind == "touch_response" and entry.touch_response.HasField("answer"):
        yield "answers", _answer_row(entry.touch_response.answer)
    elif kind == "window":
        window = entry.window
        times = {f"{name}_s": 1e-9 * (getattr(window, f"{name}_ns") - begin_ns)
                 for name in ("asked", "acquired", "last_byte", "published")}
        yield "windows", {**_vector(window.window, "origin_m"), **times, "force_n": window.force_n,
                          "pass": window.pass_ if hasattr(window, "pass_") else getattr(window, "pass")}
    elif kind == "estimate_response" and entry.estimate_response.HasField("summary"):
        summary = entry.estimate_response.summary
        row = {field.name: np.nan if field.has_presence and not summary.HasField(field.name)
               else getattr(summary, field.name)
               for field in summary.DESCRIPTOR.fields if not _is_repeated(field)}
        yield "estimates", {**row, "warnings": tuple(summary.warnings)}


def _is_repeated(field: Any) -> bool:
    # protobuf 7 has no label, the first ones no is_repeated
    return bool(field.is_repeated if hasattr(field, "is_repeated") else field.label == field.LABEL_REPEATED)


def _vector(message: Any, name: str) -> dict[str, float]:
    columns, missing = _VECTORS[name]
    return dict(zip(columns, chain(getattr(message, name), repeat(missing))))


def _answer_row(answer: palpation.TouchAnswer) -> dict[str, Any]:
    """Without a force where there is none, as ``Answer`` has it."""
    status = STATUSES.get(answer.status, "")
    has = status in ("ok", "degraded")
    force = _vector(answer, "force_n") if has else dict.fromkeys(_VECTORS["force_n"][0], np.nan)
    return {"answer": answer.answer, "sequence": answer.sequence, "status": status, **_vector(answer, "position_m"),
            **force, "energy_j": answer.energy_j if has else np.nan, "path": PATH_NAMES.get(answer.path, ""),
            "window_id": answer.window_id, "model_version": answer.model_version,
            "largest_strain": answer.largest_strain,
            "half_width": answer.budget.half_width if answer.HasField("budget") else np.nan,
            "above": answer.budget.above if answer.HasField("budget") else np.nan,
            "compute_s": 1e-9 * answer.compute_ns, "queued_s": 1e-9 * answer.queued_ns, "warning": answer.warning}


def _servo_row(sample: recording.ServoSample) -> dict[str, Any]:
    """A tick: vectors as columns, NaN or None where a field was not recorded."""
    row: dict[str, Any] = {}
    for name, is_vector, optional in _SERVO:
        if is_vector:
            row |= _vector(sample, name)
        else:
            row[name] = getattr(sample, name) if not optional or sample.HasField(name) else None
    return row
