"""What xarray keeps in a file of NetCDF comes back as it was, with its units; teletact-client writes the same."""

import numpy as np
import pytest
import xarray as xr

import teletact
from conftest import run_client

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


def estimate(process, truth, out, *more):
    run_client("estimate", "--service", process.address, "--center-frequency-hz", truth["center_frequency_hz"],
               "--sampling-frequency-hz", truth["sampling_frequency_hz"], "--frame", "PROBE", "--plane", "strain",
               "--modulus-method", "direct", "--tissue-width-m", truth["width_m"], "--tissue-depth-m",
               truth["depth_m"], "--out", out, *more)


def test_the_clients_file_is_that_of_python(process, service, patient, tmp_path):
    folder, truth = patient
    window = truth["windows"][0]
    estimate(process, truth, tmp_path / "e", "--pre", folder / window["pre"], "--post", folder / window["post"])
    pair = [teletact.read_metaimage(folder / window[name]) for name in ("pre", "post")]
    probe = {name: truth[name] for name in ("center_frequency_hz", "sampling_frequency_hz", "sound_speed_m_s",
                                            "line_pitch_m", "first_sample_depth_m")}
    service.estimate(*pair, frame="probe", plane="strain", method="direct", tissue_width_m=truth["width_m"],
                     tissue_depth_m=truth["depth_m"], modulus_time_limit_s=20, **probe).to_netcdf(tmp_path / "ours.nc")
    ours, theirs = xr.load_dataset(tmp_path / "ours.nc"), xr.load_dataset(tmp_path / "e" / "maps.nc")
    assert set(theirs.variables) == set(ours.variables)
    for name, variable in ours.variables.items():
        same = theirs[name]
        assert (same.dims, same.dtype) == (variable.dims, variable.dtype), name
        np.testing.assert_allclose(same, variable, rtol=1e-6, atol=0, err_msg=name)
        assert same.attrs["units"] == variable.attrs["units"], name
        assert name in same.dims or same.attrs["long_name"] == name.replace("_", " ")
    assert set(theirs.attrs) - set(ours.attrs) == {"Conventions"}
    for key, value in ours.attrs.items():
        if key != "stages_s":
            assert np.array_equal(np.atleast_1d(theirs.attrs[key]), np.atleast_1d(value)), key


def test_the_clients_volume_has_its_planes(process, patient, tmp_path):
    folder, truth = patient
    first, second = truth["windows"][:2]
    estimate(process, truth, tmp_path / "v", "--pre", folder / first["pre"], folder / second["pre"], "--post",
             folder / first["post"], folder / second["post"], "--z-m", 0.003, -0.002, "--force-n", 0.2,
             "--contact-area-m2", 6e-4)
    volume = xr.load_dataset(tmp_path / "v" / "volume.nc")
    assert volume.youngs_modulus.dims == ("z", "y", "x") and volume.youngs_modulus.attrs["units"] == "Pa"
    np.testing.assert_allclose(volume.z, [-0.002, 0.003])
    for k, name in enumerate(("slice-1", "slice-2")):
        plane = xr.load_dataset(tmp_path / "v" / name / "modulus.nc")
        xr.testing.assert_equal(plane.youngs_modulus, volume.youngs_modulus.isel(z=k, drop=True))
        valid = plane.valid.values
        assert valid.dtype == bool and 0.5 < valid.mean() < 1
        assert np.isfinite(plane.youngs_modulus_log_std.values[valid]).all()
        assert np.isnan(plane.youngs_modulus.values[~valid]).all()
        median = np.median(plane.youngs_modulus.values[valid])
        assert plane.attrs["background_modulus"] == pytest.approx(float(median), rel=1e-3)
