"""Recordings, written here message by message: what the tables hold, and what a tick costs."""

import tracemalloc

import numpy as np
import pandas as pd
import pytest

import teletact
from teletact.v1 import recording_pb2 as recording

BEGIN_NS = 5_000_000_000
VECTORS = {"position_m": ("x_m", "y_m", "z_m"), "velocity_m_s": ("velocity_x_m_s", "velocity_y_m_s", "velocity_z_m_s"),
           "force_n": ("force_x_n", "force_y_n", "force_z_n"),
           "lateral_stiffness_n_m": ("lateral_stiffness_x_n_m", "lateral_stiffness_z_n_m"),
           "lateral_stiffness_variance": ("lateral_stiffness_variance_x", "lateral_stiffness_variance_z")}


@pytest.fixture
def read(tmp_path):
    """Writes these entries after a header, and reads them."""
    def written_and_read(entries):
        header = recording.RecordHeader(kind="touch", version=2)
        with open(tmp_path / "a.record", "wb") as file:
            for entry in [recording.RecordEntry(header=header), *entries]:
                body = entry.SerializeToString()
                size = len(body)
                while size >= 0x80:
                    file.write(bytes([size & 0x7F | 0x80]))
                    size >>= 7
                file.write(bytes([size]) + body)
        return teletact.read_recording(tmp_path / "a.record")

    return written_and_read


def entry_at(tick, **kind):
    return recording.RecordEntry(monotonic_ns=BEGIN_NS + 1_000_000 * tick, call=1, **kind)


def tick(number, leave_out=()):
    """An entry, and its row: each number another one, NaN or None where a field is left out."""
    sample, row = recording.ServoSample(), {"time_s": 1e-9 * (1_000_000 * number)}
    for at, field in enumerate(sample.DESCRIPTOR.fields):
        there = field.name not in leave_out
        if field.name in VECTORS:
            columns = VECTORS[field.name]
            values = [number + 0.01 * at + 0.001 * k for k in range(len(columns))]
            if there:
                getattr(sample, field.name).extend(values)
            missing = np.nan if field.name.startswith("lateral") else 0.0
            row |= dict(zip(columns, values if there else [missing] * len(columns)))
            continue
        value = {field.TYPE_DOUBLE: number + 0.01 * at, field.TYPE_UINT32: number + at,
                 field.TYPE_BOOL: (number + at) % 3 == 0}[field.type]
        if there:
            setattr(sample, field.name, value)
        row[field.name] = value if there else None if field.has_presence else type(value)()
    return entry_at(number, servo=sample), row


OPTIONAL = [field.name for field in recording.ServoSample.DESCRIPTOR.fields if field.has_presence]
LATE = {"reason", "faded", "gain", "lateral_stiffness_n_m"}


@pytest.mark.parametrize("leave_out", [
    lambda number: (), lambda number: OPTIONAL, lambda number: LATE if number < 4 else (),
    lambda number: () if number < 4 else {*LATE, "force_n", "sequence", "at_border"},
], ids=["none", "all", "first", "last"])
def test_ticks_are_as_pandas_has_their_rows(read, leave_out):
    entries, rows = zip(*(tick(number, leave_out(number)) for number in range(9)))
    found = read(entries).servo
    pd.testing.assert_frame_equal(found, pd.DataFrame(rows).set_index("time_s"), check_exact=True)
    found["x_m"] *= 2  # it can be written to


def test_a_tick_costs_what_its_numbers_do(read):
    ticks = 5000
    entries = [tick(number)[0] for number in range(ticks)]
    tracemalloc.start()
    try:
        servo = read(entries).servo
        most = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    assert len(servo) == ticks and most / ticks < 500, "bytes a tick, while it is read"


def test_numbers_of_64_bits_are_kept(read):
    entries = []
    for number, window_id in enumerate((3, 2**64 - 1, 2**63)):
        entries.append(entry_at(number))
        entries[-1].touch_response.answer.window_id = window_id
        entries[-1].touch_response.answer.sequence = number
    answers = read(entries).answers
    assert list(answers.window_id) == [3, 2**64 - 1, 2**63] and answers.window_id.dtype == np.uint64
    assert list(answers.sequence) == [0, 1, 2] and answers.sequence.dtype == np.int64
    assert list(answers.call) == [1, 1, 1] and answers.force_x_n.isna().all()


def test_what_an_estimate_does_not_state_is_nan(read):
    entries = [entry_at(number) for number in range(3)]
    for entry, stated in zip(entries, (0.004, None, 0.0)):
        summary = entry.estimate_response.summary
        summary.scene_id, summary.quality = "s", 0.5
        summary.warnings.extend(["noise: a", "ramp: b"])
        if stated is not None:
            summary.youngs_modulus_correlation_m = stated
    estimates = read(entries).estimates
    np.testing.assert_array_equal(estimates.youngs_modulus_correlation_m, [0.004, np.nan, 0.0])
    assert list(estimates.scene_id) == ["s"] * 3 and estimates.warnings.iloc[1] == ("noise: a", "ramp: b")
    silent = read(entries[1:2]).estimates.youngs_modulus_correlation_m
    assert silent.dtype == np.float64 and silent.isna().all()
