"""A real service for the tests, started by them, and the client's binary."""

import contextlib
import json
import os
import pathlib
import shutil
import signal
import subprocess
import tempfile
import time
from types import SimpleNamespace

import numpy as np
import pytest
from lying_service import Liar

import teletact

BUILD = pathlib.Path(os.environ["TELETACT_BINARY_DIR"])
SOURCE = pathlib.Path(os.environ["TELETACT_SOURCE_DIR"])
CLIENT = BUILD / "client" / "teletact-client"
NOTEBOOK = SOURCE / "clients" / "python" / "examples" / "rf_to_force.ipynb"


class Process:
    """A service on a socket of its own."""

    def __init__(self, folder, *options):
        self.address = f"unix:{folder}/s"
        self._log = pathlib.Path(folder) / "service.log"
        self._options = options
        self._folder = folder
        self.start()

    def start(self):
        pathlib.Path(f"{self._folder}/s").unlink(missing_ok=True)
        with open(self._log, "w") as log:
            self._process = subprocess.Popen([BUILD / "service" / "teletact-service", "serve", "--listen", self.address,
                                              *self._options], stdout=log, stderr=subprocess.STDOUT)
        end = time.monotonic() + 300
        while "serving on" not in self.log():
            assert self._process.poll() is None and time.monotonic() < end, self.log()
            time.sleep(0.02)

    def log(self):
        return self._log.read_text()

    def wait_for_state_of(self, scene_id):
        """Until the scene is on disk, in the folder "state": its description is the last file of it."""
        until((pathlib.Path(self._folder) / "state" / "scenes" / scene_id / "scene.json").exists)

    def kill(self):
        self._process.send_signal(signal.SIGKILL)
        self._process.wait()

    def stop(self):
        self._process.terminate()
        try:
            self._process.wait(30)
        except subprocess.TimeoutExpired:
            self.kill()


def until(true, seconds=60):
    end = time.monotonic() + seconds
    while not true():
        assert time.monotonic() < end
        time.sleep(0.02)


@contextlib.contextmanager
def short_folder():
    folder = tempfile.mkdtemp(prefix="tt-py-", dir="/tmp")  # a socket's path may have 107 bytes
    try:
        yield folder
    finally:
        shutil.rmtree(folder)


@pytest.fixture(scope="session")
def process():
    with short_folder() as folder:
        process = Process(folder)
        yield process
        process.stop()


@pytest.fixture
def impatient(monkeypatch):
    """Who connects does not wait for long."""
    monkeypatch.setattr("teletact.aio._CONNECT_S", 0.2)


@pytest.fixture
def clock(monkeypatch):
    """The ROS 2 bridge's, which may be put forward."""
    clock = SimpleNamespace(ahead_s=0.0)
    clock.monotonic = lambda: time.monotonic() + clock.ahead_s
    monkeypatch.setattr("teletact_ros.bridge.time", clock)
    return clock


@pytest.fixture
def service(process):
    with teletact.connect(process.address) as service:
        yield service


@pytest.fixture
def kept():
    """A service of the test's own that keeps its scenes on disk, and a client of it, with a scene of that name."""
    with short_folder() as folder:
        process = Process(folder, "--state", f"{folder}/state")
        try:
            with teletact.connect(process.address) as service:
                service.create_scene("kept", np.full((20, 40), 1e4), x_m=np.linspace(0, 0.08, 41),
                                     y_m=np.linspace(0, 0.04, 21))
                yield process, service
        finally:
            process.stop()


@pytest.fixture(scope="module")
def liar():
    with short_folder() as folder:
        liar = Liar()
        server = liar.serve(f"unix:{folder}/liar")
        yield liar
        server.stop(None).wait()


@pytest.fixture
def lied_to(liar):
    liar.over.clear()
    with teletact.connect(liar.address) as service:
        yield service


def run_client(*arguments):
    done = subprocess.run([CLIENT, *map(str, arguments)], capture_output=True, text=True, timeout=300)
    assert done.returncode == 0, done.stderr
    return done


@pytest.fixture(scope="session")
def patient(tmp_path_factory):
    """Two neighbouring windows of a simulated patient, with what is known of them."""
    folder = tmp_path_factory.mktemp("patient")
    run_client("patient", "--seed", 7, "--window-x-m", 0.04, 0.1, "--out", folder)
    return folder, json.loads((folder / "truth.json").read_text())


LUMP_X_M, LUMP_Y_M = np.linspace(0, 0.1, 101), np.linspace(0, 0.04, 41)


@pytest.fixture(scope="session")
def lump(process):
    """A scene of 100 x 40 mm with a stiff lump in its middle."""
    modulus = np.full((40, 100), 1e4)
    modulus[12:22, 45:55] = 4e4
    with teletact.connect(process.address) as service:
        service.create_scene("lump", modulus, x_m=LUMP_X_M, y_m=LUMP_Y_M)
    return "lump"
