"""MetaImage files: those of teletact-client, ITK, PLUS and SUPRA are read, and what would be read with wrong numbers or
axes is refused."""

import os
import zlib

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


@pytest.mark.parametrize("changes, words", [
    ({"TransformMatrix": "0 1 1 0"}, "TransformMatrix is not the identity; resample the image to its own axes"),
    ({"Rotation": "1 0 0 -1"}, "Rotation is not the identity"), ({"Orientation": "0 -1 1 0"}, "is not the identity"),
    ({"Orientation": "1 0 0 0 1 0 0 0 1"}, "header field Orientation has 9 values, not 4; correct the header"),
    ({"TransformMatrix": "1 0 0 nan"}, "header field TransformMatrix: 'nan' is not a number; correct the header"),
    ({"BinaryData": "0"}, "BinaryData = False is not supported; save it as binary"),
    ({"ElementType": "MET_LONG_LONG"}, "MET_LONG_LONG is not supported; use MET_SHORT"),
    ({"NDims": "5"}, "NDims must be a whole number from 1 to 4"), ({"NDims": "1"}, "NDims must be 2, 3 or 4"),
    ({"ElementNumberOfChannels": "\u00b2"}, "'\u00b2' is not a number"),
    ({"DimSize": None}, "header field DimSize is missing; add it"), ({"DimSize ": "2 3"}, "DimSize is given twice; keep one"),
    ({"DimSize": "2 4"}, "its header declares 16 bytes of samples but 12 follow; the file is truncated"),
    ({"DimSize": "2 2"}, "the file is corrupt: copy or export it again"),
    ({"ElementSpacing": None}, "header field ElementSpacing is missing; add it: metres"),
    ({"ElementSpacing": "0.001"}, "has 1 values, not 2"), ({"ElementSpacing": "0.001 0"}, "must be positive"),
    ({"HeaderSize": "17"}, "HeaderSize = 17 is not supported"),
], ids=str)
def test_what_is_refused(read, changes, words):
    with pytest.raises(teletact.DamagedFile) as caught:
        read(changes)
    assert caught.value.field == next(iter(changes)).strip() and words in str(caught.value), caught.value


@pytest.mark.parametrize("header, words", [
    (b"", "is not a MetaImage"), (b"\n\n", "is not a MetaImage"), (b"NDims = 2\nand more\n", "header line 'and more' has no '='"),
    (b"NDims = 2\nComment = " + b"a" * (16 << 20), "its header is longer than 16 MiB; save fewer frames in one file"),
], ids=["empty", "blank", "text", "long"])
def test_headers_that_are_refused(tmp_path, header, words):
    (tmp_path / "a.mha").write_bytes(header)
    with pytest.raises(teletact.DamagedFile, match=words):
        teletact.read_metaimage(tmp_path / "a.mha")


def test_what_is_no_file_is_refused_and_not_waited_for(tmp_path):
    os.mkfifo(tmp_path / "pipe")
    for path in (tmp_path / "pipe", tmp_path, "/dev/zero"):
        with pytest.raises(teletact.DamagedFile, match="is not a file"):
            teletact.read_metaimage(path)


def test_headers_are_read_as_metaio_does(tmp_path):
    fields = "".join(f"{name} = {value}\n" for name, value in HEADER.items()) + "\n \r\nComment : with a colon = fine\n"
    (tmp_path / "a.mha").write_bytes(fields.encode() + b"ElementDataFile = LOCAL\n" + np.arange(6, dtype="<i2").tobytes())
    np.testing.assert_array_equal(teletact.read_metaimage(tmp_path / "a.mha").values, COUNTED)


def test_what_teletact_client_writes_is_read():
    image = teletact.read_metaimage(SOURCE / "tests" / "fuzzers" / "corpus" / "metaimage" / "rf_int16.mha")
    assert image.dtype == np.int16 and image.shape == (4, 3) and image.y[1] == 1.9e-5 and image.x[1] == 3e-4


def image_of(path, fields, data):
    path.write_bytes("".join(f"{name} = {value}\n" for name, value in (HEADER | fields).items()).encode() + data)
    return path


COUNTED = np.arange(6).reshape(3, 2).T  # y, x


@pytest.mark.parametrize("true", ["True", "true", "T", "1"])
@pytest.mark.parametrize("field", ["BinaryDataByteOrderMSB", "ElementByteOrderMSB"])
@pytest.mark.parametrize("packed", [False, True])
def test_both_byte_orders_packed_or_not(tmp_path, field, true, packed):
    data = np.arange(6, dtype=">i2").tobytes()
    fields = {field: true} | ({"CompressedData": "1", "HeaderSize": "-1"} if packed else {})
    image = teletact.read_metaimage(image_of(tmp_path / "a.mha", fields | {"ElementDataFile": "LOCAL"},
                                             zlib.compress(data) if packed else data))
    assert image.dtype == np.int16
    np.testing.assert_array_equal(image.values, COUNTED)


@pytest.mark.parametrize("name", ["char.mha", "uchar.mhd", "short.mha", "short_packed.mha", "ushort_packed.mha",
                                  "int_packed.mhd", "uint.mha", "float_packed.mha", "double.mha"])
def test_what_itk_writes_is_read(name):
    image = teletact.read_metaimage(SOURCE / "tests" / "files" / "itk" / name)
    np.testing.assert_array_equal(image.values.T.ravel(), 7.0 * np.arange(12) - 30 + 100 * name.startswith("u"))
    np.testing.assert_allclose(image.x, 0.002 + 3e-4 * np.arange(3))


def test_a_sequence_of_plus_has_frames(tmp_path):
    fields = {f"Seq_Frame{k:04}_Transform{n}": "1 0 0 0 0 1 0 0 0 0 1 0 0 0 0 1" for k in range(400) for n in range(4)}
    fields |= {"NDims": "3", "DimSize": "2 3 2", "ElementSpacing": "0.001 0.002 1", "Offset": "0 0.01 0",
               "UltrasoundImageType": "RF_REAL", "UltrasoundImageOrientation": "FM", "ElementDataFile": "LOCAL"}
    data = np.arange(12, dtype="<i2").tobytes()
    image = teletact.read_metaimage(image_of(tmp_path / "a.mha", fields, data))
    assert image.dims == ("y", "x", "frame") and (tmp_path / "a.mha").stat().st_size > 1 << 16
    np.testing.assert_array_equal(image.isel(frame=1).values, COUNTED + 6)
    turned = fields | {"UltrasoundImageOrientation": "MFA", "UltrasoundImageType": "BRIGHTNESS"}
    with pytest.warns(UserWarning, match="BRIGHTNESS"):
        image = teletact.read_metaimage(image_of(tmp_path / "a.mha", turned, data))
    np.testing.assert_array_equal(image.isel(frame=0).values, COUNTED.T)
    assert image.x[1] == 0.001 and image.y[0] == 0.01


@pytest.mark.parametrize("name", ["/etc/passwd", "../a.raw", "..", "LIST", "a%d.raw 1 2 1"])
def test_data_of_others_are_not_read(tmp_path, name):
    with pytest.raises(teletact.DamagedFile, match="beside this one"):
        teletact.read_metaimage(image_of(tmp_path / "a.mhd", {"ElementDataFile": name}, b""))


@pytest.mark.parametrize("data", [b"no zlib at all", zlib.compress(b"1234")[:-2], zlib.compress(b"1" * 13),
                                  zlib.compress(b"1" * 11)])
def test_damaged_packed_data_are_refused(tmp_path, data):
    with pytest.raises(teletact.DamagedFile, match="its packed samples are damaged"):
        teletact.read_metaimage(image_of(tmp_path / "a.mha", {"CompressedData": "True", "ElementDataFile": "LOCAL"},
                                         data))
