"""Recordings of teletact-client (``touch --record``, ``acquire --record``) as DataFrames."""

from __future__ import annotations

from dataclasses import dataclass, field
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
_AXES = "xyz"
_VECTORS = {  # fields of three components, and the names of their columns
    "position_m": "{}_m", "velocity_m_s": "velocity_{}_m_s", "force_n": "force_{}_n"}
_LATERAL = {"lateral_stiffness_n_m": "lateral_stiffness_{}_n_m",
            "lateral_stiffness_variance": "lateral_stiffness_variance_{}"}


@dataclass
class Recording:
    """What was recorded. Every table's index is ``time_s`` since the first entry, by the recorder's clock.

    Names of columns end in their units. ``servo``: one row for each tick; ``poses`` and ``answers`` of the touch
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
    """The same of an open file, or of the socket of a session that is published. ``path``: for messages."""
    damaged = DamagedFile(f"the recording '{path}' is damaged", remedy="record it anew")
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
    """Raises DamagedFile where it is none, of another version, or damaged."""
    messages = entries(path)
    try:
        first = next(messages, None)
    except DamagedFile as error:
        raise (_no_recording(path) if "damaged" in error.problem else error) from None
    header = check_header(first, path)
    out = Recording(header.kind, header.scene_id, header.service, header.client, header.unix_time_s,
                    tuple(header.arguments))
    rows: dict[str, list[dict[str, Any]]] = {name: [] for name in ("servo", "poses", "answers", "windows", "estimates")}
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
            rows[name].append({"time_s": time_s, "call": entry.call, **row} if name != "servo"
                              else {"time_s": time_s, **row})
        if entry.HasField("touch_response"):
            _take_law(entry, books)
    for name, of_table in rows.items():
        if of_table:
            setattr(out, name, pd.DataFrame(of_table).set_index("time_s"))
    out.laws = {call: book.law() for call, book in books.items() if book.pieces}
    return out


def _no_recording(path: str | Path) -> DamagedFile:
    return DamagedFile(f"'{path}' is no recording of teletact-client",
                       remedy="give a file of touch or acquire --record")


def check_header(first: recording.RecordEntry | None, path: str | Path) -> recording.RecordHeader:
    """That of the first entry. Raises DamagedFile where it is none, or of another version."""
    if first is None or not first.HasField("header"):
        raise _no_recording(path)
    if first.header.version != _VERSION:
        raise DamagedFile(f"the recording '{path}' is of version {first.header.version}, and version {_VERSION} is read",
                          remedy="record it anew")
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
        yield "servo", _plain(entry.servo)
    elif kind == "touch_request" and entry.touch_request.HasField("pose"):
        pose = entry.touch_request.pose
        yield "poses", {"sequence": pose.sequence, **_vector(pose, "position_m"), **_vector(pose, "velocity_m_s")}
    elif kind == "touch_response" and entry.touch_response.HasField("answer"):
        yield "answers", _answer_row(entry.touch_response.answer)
    elif kind == "window":
        window = entry.window
        times = {f"{name}_s": 1e-9 * (getattr(window, f"{name}_ns") - begin_ns)
                 for name in ("asked", "acquired", "last_byte", "published")}
        yield "windows", {**_components(window.window.origin_m, "{}_m"), **times, "force_n": window.force_n,
                          "pass": window.pass_ if hasattr(window, "pass_") else getattr(window, "pass")}
    elif kind == "estimate_response" and entry.estimate_response.HasField("summary"):
        summary = entry.estimate_response.summary
        row = {name.name: getattr(summary, name.name) for name in summary.DESCRIPTOR.fields
               if name.label != name.LABEL_REPEATED}
        yield "estimates", {**row, "warnings": tuple(summary.warnings)}


def _components(values: Any, name: str) -> dict[str, float]:
    return {name.format(axis): values[k] if k < len(values) else 0.0 for k, axis in enumerate(_AXES)}


def _vector(message: Any, name: str) -> dict[str, float]:
    return _components(getattr(message, name), _VECTORS[name])


def _answer_row(answer: palpation.TouchAnswer) -> dict[str, Any]:
    """Without a force where there is none, as ``Answer`` has it."""
    status = STATUSES.get(answer.status, "")
    force = {_VECTORS["force_n"].format(axis): np.nan for axis in _AXES}
    if status in ("ok", "degraded"):
        force = _vector(answer, "force_n")
    has = status in ("ok", "degraded")
    return {"answer": answer.answer, "sequence": answer.sequence, "status": status, **_vector(answer, "position_m"),
            **force, "energy_j": answer.energy_j if has else np.nan, "path": PATH_NAMES.get(answer.path, ""),
            "window_id": answer.window_id, "model_version": answer.model_version,
            "largest_strain": answer.largest_strain,
            "half_width": answer.budget.half_width if answer.HasField("budget") else np.nan,
            "compute_s": 1e-9 * answer.compute_ns, "queued_s": 1e-9 * answer.queued_ns, "warning": answer.warning}


def _plain(sample: recording.ServoSample) -> dict[str, Any]:
    """A tick: vectors as columns, NaN or None where a field was not recorded."""
    row: dict[str, Any] = {}
    for descriptor in sample.DESCRIPTOR.fields:
        name = descriptor.name
        value = getattr(sample, name)
        if name in _VECTORS:
            row |= _components(value, _VECTORS[name])
        elif name in _LATERAL:
            row |= {_LATERAL[name].format(axis): value[k] if k < len(value) else np.nan
                    for k, axis in enumerate("xz")}
        elif descriptor.has_presence:
            row[name] = value if sample.HasField(name) else None
        else:
            row[name] = value
    return row
