"""What xarray keeps in a file of NetCDF comes back as it was, with its units."""

import numpy as np
import pytest
import xarray as xr

import teletact

pytest.importorskip("netCDF4")


def test_an_estimate_a_scene_and_a_path_are_kept(service, lump, patient, tmp_path):
    folder, truth = patient
    window = truth["windows"][0]
    pair = [teletact.read_metaimage(folder / window[name]) for name in ("pre", "post")]
    probe = {name: truth[name] for name in ("center_frequency_hz", "sampling_frequency_hz", "sound_speed_m_s",
                                            "line_pitch_m", "first_sample_depth_m")}
    maps = service.estimate(*pair, frame="probe", plane="strain", method="direct", force_n=window["force_n"],
                            contact_area_m2=window["contact_area_m2"], **probe)
    with service.touch(lump) as touch:
        path = touch.along([[0.04, 0.001], [0.05, 0.002]])
    for name, given in {"maps": maps, "scene": service.modulus(lump), "path": path}.items():
        given.to_netcdf(tmp_path / f"{name}.nc")
        read = xr.load_dataset(tmp_path / f"{name}.nc")
        assert set(read.variables) == set(given.variables)
        for variable in given.variables:
            np.testing.assert_array_equal(read[variable], given[variable])
            assert read[variable].attrs.get("units") == given[variable].attrs.get("units")
        for key, value in given.attrs.items():
            assert np.array_equal(np.atleast_1d(read.attrs[key]), np.atleast_1d(value)), key
    assert maps.youngs_modulus.attrs["units"] == "Pa" and maps.x.attrs["units"] == "m" and maps.attrs["stages"]
