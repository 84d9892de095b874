"""MetaImage files: those of teletact-client are read, and what would be read with wrong numbers or axes is refused."""

import numpy as np
import pytest
from conftest import SOURCE

import teletact

HEADER = {"ObjectType": "Image", "NDims": "2", "BinaryData": "True", "BinaryDataByteOrderMSB": "False",
          "CompressedData": "False", "Offset": "0 0.01", "ElementSpacing": "0.001 0.002", "DimSize": "2 3",
          "ElementType": "MET_SHORT"}


@pytest.fixture
def read(tmp_path):
    """Writes an image of 2 x 3 with this changed in its header (None: left out), and reads it."""
    def written_and_read(changes):
        fields = {name: value for name, value in (HEADER | changes | {"ElementDataFile": "LOCAL"}).items()
                  if value is not None}
        header = "".join(f"{name} = {value}\n" for name, value in fields.items())
        (tmp_path / "a.mha").write_bytes(header.encode("latin-1") + np.arange(6, dtype="<i2").tobytes())
        return teletact.read_metaimage(tmp_path / "a.mha")

    return written_and_read


@pytest.mark.parametrize("changes", [
    {}, {"TransformMatrix": "1 0 0 1"}, {"Rotation": "1.0 0 -0 1"}, {"Orientation": "1 0 0 1"},
    {"BinaryDataByteOrderMSB": None, "ElementByteOrderMSB": "0"}, {"BinaryData": "1", "CompressedData": "F"},
    {"Offset": None, "Position": "0 0.01"}, {"Offset": None, "Origin": "0 0.01"},
], ids=str)
def test_what_is_read(read, changes):
    image = read(changes)
    np.testing.assert_array_equal(image.values, [[0, 2, 4], [1, 3, 5]])
    np.testing.assert_allclose(image.y, [0, 0.001])
    np.testing.assert_allclose(image.x, [0.01, 0.012, 0.014])


@pytest.mark.parametrize("changes, remedy", [
    ({"TransformMatrix": "0 1 1 0"}, "resample"), ({"Rotation": "1 0 0 -1"}, "resample"),
    ({"Orientation": "0 -1 1 0"}, "resample"), ({"Orientation": "1 0 0 0 1 0 0 0 1"}, "4 finite numbers"),
    ({"TransformMatrix": "1 0 0 nan"}, "4 finite numbers"),
    *(({field: true}, "little-endian") for field in ("BinaryDataByteOrderMSB", "ElementByteOrderMSB")
      for true in ("True", "true", "TRUE", "T", "1")),
    ({"CompressedData": "1"}, "uncompressed"), ({"BinaryData": "0"}, "binary"),
    ({"ElementNumberOfChannels": "\u00b2"}, "1 finite number"), ({"DimSize ": "2 3"}, "keep one"),
    ({"ElementSpacing": None}, "metres"), ({"ElementSpacing": "0.001"}, "2 finite numbers"),
], ids=str)
def test_what_is_refused(read, changes, remedy):
    with pytest.raises(teletact.DamagedFile) as caught:
        read(changes)
    assert caught.value.field == next(iter(changes)).strip() and remedy in caught.value.remedy, caught.value


def test_what_teletact_client_writes_is_read():
    image = teletact.read_metaimage(SOURCE / "tests" / "fuzzers" / "corpus" / "metaimage" / "rf_int16.mha")
    assert image.dtype == np.int16 and image.shape == (4, 3) and image.y[1] == 1.9e-5 and image.x[1] == 3e-4
