"""The notebook runs, and its figures are those of the C++ client: the modulus of a pair, the force along a path."""

import base64
import json
import os
import re

import numpy as np
import pytest
from conftest import NOTEBOOK, run_client

import teletact

@pytest.fixture(scope="module")
def cells(process, patient):
    """What the notebook's cells leave behind, run one after the other as plain Python."""
    notebook = json.loads(NOTEBOOK.read_text())
    assert not any(cell.get("outputs") for cell in notebook["cells"]), "commit it without outputs"
    os.environ |= {"TELETACT_SERVICE": process.address, "TELETACT_PATIENT": str(patient[0])}
    names = {}
    for cell in notebook["cells"]:
        if cell["cell_type"] == "code":
            exec(compile("".join(cell["source"]), NOTEBOOK.name, "exec"), names)
    return names


def vti_array(path, name):
    """An array of a VTI file as teletact-client writes it: (y, x), float32, after the count of its bytes."""
    text = path.read_text()
    extent = [int(word) for word in re.search(r'WholeExtent="([^"]*)"', text)[1].split()]
    data = base64.b64decode(re.search(rf'<DataArray type="Float32" Name="{name}"[^>]*>([^<]*)<', text)[1])
    return np.frombuffer(data[8:], "<f4").reshape(extent[3] - extent[2] + 1, extent[1] - extent[0] + 1)


def test_the_modulus_is_that_of_teletact_client(cells, process, patient, tmp_path):
    folder, truth = patient
    window = truth["windows"][0]
    run_client("estimate", "--service", process.address, "--pre", folder / window["pre"], "--post",
               folder / window["post"], "--center-frequency-hz", truth["center_frequency_hz"],
               "--sampling-frequency-hz", truth["sampling_frequency_hz"], "--frame", "PROBE", "--plane", "strain",
               "--modulus-method", "direct", "--force-n", repr(window["force_n"]), "--contact-area-m2",
               repr(window["contact_area_m2"]), "--tissue-width-m", truth["width_m"], "--tissue-depth-m",
               truth["depth_m"], "--out", tmp_path / "e")
    summary = json.loads((tmp_path / "e" / "estimate.json").read_text())
    maps = cells["maps"]
    assert maps.attrs["background_modulus"] == pytest.approx(summary["modulus"]["background"], rel=1e-6)
    assert maps.attrs["modulus_method"] == summary["modulus"]["method"] == "direct"
    assert float(maps.valid.mean()) == pytest.approx(summary["valid_fraction"], abs=1e-6)
    theirs = vti_array(tmp_path / "e" / "modulus.vti", "youngs_modulus")
    valid = maps.valid.values
    assert theirs.shape == valid.shape and valid.mean() > 0.5
    np.testing.assert_allclose(maps.youngs_modulus.values[valid], theirs[valid], rtol=1e-6)
    assert np.isnan(maps.youngs_modulus.values[~valid]).all()
    grid = summary["grid"]
    np.testing.assert_allclose(maps.x.values, grid["origin_m"][0] + grid["spacing_m"][0] * np.arange(grid["size"][0]))


def test_the_force_is_what_teletact_client_was_answered(cells, process, tmp_path):
    """The answers in a recording, asked for again at the same places; and the law, by its own statement."""
    record = tmp_path / "touch.record"
    run_client("touch", "--service", process.address, "--scene", cells["scene_id"], "--device", "simulated",
               "--begin-m", 0.06, "--end-m", 0.14, "--passes", 1, "--record", record)
    recording = teletact.read_recording(record)
    assert recording.kind == "touch" and recording.scene_id == cells["scene_id"] and not recording.cut_short
    answers = recording.answers
    pressed = answers[(answers.status == "ok") & (answers.force_y_n < -0.01)]
    assert len(pressed) > 10
    some = pressed.iloc[:: max(1, len(pressed) // 100)]
    places = some[["x_m", "y_m", "z_m"]].to_numpy()
    recorded = some[["force_x_n", "force_y_n", "force_z_n"]].to_numpy()
    with teletact.connect(process.address) as service, service.touch(cells["scene_id"]) as touch:
        felt = touch.along(places).force.values
    np.testing.assert_allclose(felt, recorded, rtol=1e-6, atol=1e-9)
    law = cells["law"](places)
    assert law.known.all()
    off = np.linalg.norm(law.force_n - recorded, axis=1)
    assert np.quantile(off / law.error_n, 0.98) <= 1, "it is off by more than it says"
    # What was felt by the law there, on the servo's side, is the law that the recording holds.
    assert recording.servo.by_law.mean() > 0.5 and recording.laws
    stored = next(iter(recording.laws.values()))
    ticks = recording.servo[recording.servo.by_law & (recording.servo.force_y_n < -0.01)]
    by_law = stored(ticks[["x_m", "y_m", "z_m"]].to_numpy())
    assert by_law.known.all()


def test_the_notebooks_law_and_answers_agree(cells):
    by_law, felt = cells["by_law"], cells["felt"]
    assert by_law.known.all() and (felt.status == "ok").all()
    assert np.quantile(cells["off_n"] / by_law.error_n, 0.98) <= 1
    assert 0.05 < cells["push_n"].max() < 5
    inclusion = 0.0567  # the patient's first, at the windows' left
    near = np.abs(felt.x.values - inclusion) < 0.01
    assert cells["push_n"][near].max() > 1.1 * np.median(cells["push_n"]), "the inclusion is felt"
