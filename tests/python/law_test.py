"""The contact law in NumPy is that of C++ (common/contact_law, client/link/law_book), over planes, solids, versions and guesses."""

import subprocess

import numpy as np
import pytest
from conftest import BUILD

import teletact
from teletact.law_book import LawBook
from teletact.v1 import palpation_pb2 as palpation


def delimited(message):
    body = message.SerializeToString()
    size, out = len(body), bytearray()
    while size > 0x7F:
        out.append(size & 0x7F | 0x80)
        size >>= 7
    return bytes(out) + bytes([size]) + body


def by_cpp(pieces, poses, folder):
    (folder / "pieces").write_bytes(b"".join(map(delimited, pieces)))
    (folder / "poses").write_bytes(np.ascontiguousarray(poses, "<f8").tobytes())
    done = subprocess.run([BUILD / "tests" / "teletact-law-values",
                           *(folder / name for name in ("pieces", "poses", "values"))],
                          capture_output=True, text=True, check=True)
    return np.frombuffer((folder / "values").read_bytes()).reshape(-1, 11), done.stderr


def random_piece(rng, number, x_m, z_m=0.0, before_m=None, area=False, version=1, guess=False):
    piece = palpation.LawPiece(piece=number, window_id=1, model_version=version, begin_x_m=x_m[0], end_x_m=x_m[-1],
                               force_error_share=0.01, force_error_n=0.002, z_m=z_m,
                               lane_before_m=z_m if before_m is None else before_m, guess=guess)
    for x in x_m:
        column = piece.columns.add(x_m=x, of_force_error=rng.choice([0.0, 0.5]))
        rows = rng.integers(1, 7)
        depth = np.log(1e-3 * np.cumsum(rng.uniform(0.2, 1, rows)))
        column.log_indentation.extend(depth)
        for row, s in enumerate(depth):
            # Near ln U = 2.4 s + c, so that the energy grows with depth.
            sample = [2.4 * s + 6 + 0.2 * np.sin(40 * x + 30 * z_m), 8 * np.cos(40 * x), 2.4 + rng.normal(0, 0.1),
                      rng.normal(0, 3)]
            column.samples.extend(sample + ([rng.normal(0, 3), rng.normal(0, 2), rng.normal(0, 50), rng.normal(0, 30)]
                                            if area else []))
    return piece


def pieces_of_a_plane(rng):
    yield random_piece(rng, 1, np.linspace(0.01, 0.05, 7))
    yield random_piece(rng, 2, np.linspace(0.06, 0.09, 5))             # a gap before it
    yield random_piece(rng, 3, np.linspace(0.04, 0.07, 6), version=3)  # newer, over both borders
    yield random_piece(rng, 4, np.linspace(0.02, 0.06, 4), version=2)  # older: it stays out of what is newer
    yield random_piece(rng, 5, np.linspace(0.093, 0.099, 3))           # the gap before it stays


def pieces_of_a_solid(rng):
    lanes = np.array([-0.012, -0.006, 0.0, 0.006])
    number = 0
    for k, z in enumerate(lanes):
        number += 1
        before = lanes[k - 1] if k else z
        yield random_piece(rng, number, np.linspace(0.01, 0.04, 6 + k), z, before, True, guess=k > 1)
    yield random_piece(rng, number + 1, np.linspace(0.01, 0.04, 8), lanes[2], lanes[1], True)  # it is corrected
    yield random_piece(rng, number + 2, np.linspace(0.02, 0.03, 4), lanes[1], lanes[0], True, version=2)
    # A lane that another one is missing before.
    yield random_piece(rng, number + 3, np.linspace(0.01, 0.04, 5), 0.02, 0.014, True)


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("make", [pieces_of_a_plane, pieces_of_a_solid])
def test_values_are_those_of_cpp(make, seed, tmp_path):
    rng = np.random.default_rng(seed)
    pieces = list(make(rng))
    n = 4000
    poses = np.column_stack([rng.uniform(0, 0.1, n), rng.uniform(-0.0005, 0.008, n), rng.uniform(-0.015, 0.022, n)])
    places = np.array([column.x_m for piece in pieces for column in piece.columns])
    poses[:len(places), 0] = places  # on columns, and their lanes
    poses[:len(places), 2] = [piece.z_m for piece in pieces for _ in piece.columns]
    poses[-1] = [0.02, 0.0, 0.0]
    book = LawBook()
    for piece in pieces:
        book.take(piece)
    ours = book.law().evaluate(*poses.T)
    theirs, refused = by_cpp(pieces, poses, tmp_path)
    assert not refused
    np.testing.assert_array_equal(ours.known, theirs[:, 6].astype(bool))
    assert 0.1 < ours.known.mean() < 0.95, "both kinds of places are tried"
    known = ours.known
    assert np.isnan(ours.energy_j[~known]).all() and np.isnan(ours.force_n[~known]).all()
    assert (theirs[:, 5] > 0).sum() > 50, "versions or guesses meet somewhere"
    for value, column in ((ours.energy_j, 0), (-ours.force_n[:, 0], 1), (-ours.force_n[:, 1], 2),
                          (-ours.force_n[:, 2], 3), (ours.error_n, 4)):
        scale = np.abs(theirs[known, column]).max()
        np.testing.assert_allclose(value[known], theirs[known, column], rtol=1e-9, atol=1e-12 * max(scale, 1e-30))
    for flags, column in ((ours.beyond, 7), (ours.corrected, 8), (ours.oldest_version, 9), (ours.newest_version, 10)):
        np.testing.assert_array_equal(flags[known], theirs[known, column])


def test_what_is_malformed_is_refused_as_in_cpp(tmp_path):
    rng = np.random.default_rng(1)
    spoilers = [
        lambda piece: piece.columns[1].samples.append(1.0),
        lambda piece: piece.columns[1].log_indentation.__setitem__(0, float("nan")),
        lambda piece: piece.columns[1].samples.__setitem__(2, -1.0),
        lambda piece: setattr(piece.columns[1], "x_m", piece.columns[0].x_m),
        lambda piece: setattr(piece.columns[0], "x_m", -100.0),
        lambda piece: setattr(piece, "force_error_share", float("inf")),
        lambda piece: setattr(piece, "end_x_m", 0.0),
        lambda piece: setattr(piece, "piece", 7),
        lambda piece: piece.ClearField("columns"),
    ]
    for spoil in spoilers:
        piece = random_piece(rng, 1, np.linspace(0.01, 0.05, 7))
        spoil(piece)
        book = LawBook()
        with pytest.raises(teletact.BadAnswer, match="law"):
            book.take(piece)
        assert not book.law().columns
        _, refused = by_cpp([piece], np.zeros((1, 3)), tmp_path)
        assert "refused" in refused


def test_a_law_of_nothing_says_nothing():
    law = LawBook().law()
    values = law([[0.01, 0.002]])
    assert not values.known.any() and np.isnan(values.force_n).all()


def test_energy_and_force_fit_together():
    book = LawBook()
    for piece in pieces_of_a_solid(np.random.default_rng(2)):
        book.take(piece)
    law, at, step = book.law(), np.array([[0.0234, 0.0021, -0.0043]]), 1e-7
    for axis in range(3):
        off = np.eye(3)[[axis]] * step
        slope = (law(at + off).energy_j - law(at - off).energy_j) / (2 * step)
        assert law(at).force_n[0, axis] == pytest.approx(-slope[0], rel=1e-5)
