"""A service that asks who calls: those with a token, and nobody else."""

import subprocess

import pytest
from conftest import SOURCE, Process, short_folder

import teletact


@pytest.mark.parametrize("field", ["tls_ca", "token_file"])
def test_files_without_an_end_are_refused(field):
    with pytest.raises(teletact.InvalidArgument, match="/dev/zero holds more than 1048576 bytes"):
        teletact.connect("127.0.0.1:1", **{field: "/dev/zero"})


def test_roles_are_let_in_and_others_are_told_why(monkeypatch):
    with short_folder() as folder:
        made = f"{folder}/set"
        subprocess.run([SOURCE / "packaging/teletact-credentials", "--out", made], check=True, capture_output=True)
        process = Process(folder, "--tls-certificate", f"{made}/server.pem", "--tls-key", f"{made}/server-key.pem",
                          "--access", f"{made}/access.toml")
        ca = f"{made}/ca.pem"
        try:
            with pytest.raises(teletact.NotPermitted, match="UNAUTHENTICATED"):
                teletact.connect(process.address, tls_ca=ca)
            with monkeypatch.context() as patched, pytest.raises(teletact.Unavailable, match="tls_ca"):
                patched.setattr("teletact.aio._CONNECT_S", 0.2)
                teletact.connect(process.address)
            with teletact.connect(process.address, tls_ca=ca, token_file=f"{made}/administrator.token") as service:
                service.create_scene("s", [[1e4] * 8] * 4, x_m=[0.01 * k for k in range(9)],
                                     y_m=[0.01 * k for k in range(5)])
            with open(f"{made}/operator.token") as file:
                token = file.read().strip()
            with teletact.connect(process.address, tls_ca=ca, token=token) as service:
                with service.touch("s") as touch:
                    assert touch.at([0.04, 0.002]).force_n[1] < 0
                with pytest.raises(teletact.NotPermitted, match="DeleteScene: PERMISSION_DENIED: .*operator"):
                    service.delete_scene("s")
        finally:
            process.stop()
