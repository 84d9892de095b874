#!/usr/bin/env python3
"""The Python client as pip installs it: wheels, source archive and folder, into empty environments.

    tests/packaging/wheels_test.py --build build/release
    tests/packaging/wheels_test.py --service 127.0.0.1:50051 --python /usr/bin/python3.14

By each Python from 3.11 to 3.14 that is found, with the newest and the oldest grpcio and protobuf that the metadata
allow, of stubs by protoc and by the newest grpcio-tools: a scene is made and touched. Takes an index of Python
packages; exits with 77, and says so, where none answers.
"""
import argparse, contextlib, os, shutil, subprocess, sys, tempfile, time
from pathlib import Path

VERSIONS = ["3.11", "3.12", "3.13", "3.14"]
PACKAGE = Path(__file__).resolve().parents[2] / "clients/python"
WHICH = "import ensurepip, sys; print('%d.%d' % sys.version_info[:2], sys.executable)"
TOUCH = """
import sys, google.protobuf, grpc, numpy, teletact
with teletact.connect(sys.argv[1]) as service:
    service.create_scene(sys.argv[2], numpy.full((20, 40), 1e4), x_m=numpy.linspace(0, 0.08, 41),
                         y_m=numpy.linspace(0, 0.04, 21))
    with service.touch(sys.argv[2]) as touch:
        assert touch.at([0.04, 0.001]).force_n[1] < 0
    service.delete_scene(sys.argv[2])
print(f"grpcio {grpc.__version__}, protobuf {google.protobuf.__version__}, numpy {numpy.__version__}")
"""


def run(*words, **options):
    """What it prints; shows that, and ends the test, where it fails."""
    done = subprocess.run([str(word) for word in words], stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True,
                          timeout=900, **options)
    assert done.returncode == 0, f"{' '.join(map(str, words))}:\n{done.stdout}"
    return done.stdout


def environment(folder, python):
    run(python, "-m", "venv", folder)
    return folder / "bin/python"


def pythons(given):
    """By version; pyenv's names for Pythons that are not there fail."""
    found = {}
    for python in given or [f"python{version}" for version in VERSIONS]:
        if shutil.which(python):
            told = subprocess.run([python, "-c", WHICH], capture_output=True, text=True)
            if told.returncode == 0:
                version, path = told.stdout.split()
                found[version] = path
    return found


class Service:
    """Ends with the block that it is for."""

    def __init__(self, build, folder):
        self.address = f"unix:{folder}/s"
        self.log = folder / "service.log"
        self.command = [build / "service/teletact-service", "serve", "--listen", self.address]

    def __enter__(self):
        with self.log.open("w") as log:
            self.process = subprocess.Popen(self.command, stdout=log, stderr=subprocess.STDOUT)
        end = time.monotonic() + 300
        while "serving on" not in self.log.read_text():
            assert self.process.poll() is None and time.monotonic() < end, self.log.read_text()
            time.sleep(0.1)
        return self.address

    def __exit__(self, *_):
        self.process.kill()
        self.process.wait()


def built(python, folder, path):
    """A wheel, built in isolation with what is on that PATH."""
    run(python, "-m", "pip", "wheel", "--no-deps", "-w", folder, PACKAGE, env={**os.environ, "PATH": path})
    return next(folder.glob("*.whl"))


def archive(tools, folder):
    run(tools, "-m", "build", "--sdist", "-o", folder, PACKAGE)
    return next(folder.glob("*.tar.gz"))


def try_all(tools, python, version, folder, address):
    """Every way into an environment of its own, and a touch from there."""
    without_protoc = str(Path(environment(folder / "bare", python)).parent)
    wheels = {"grpcio-tools": built(python, folder / "new", without_protoc)}
    if shutil.which("protoc") and shutil.which("grpc_python_plugin"):
        wheels["protoc"] = built(python, folder / "old", os.environ["PATH"])
    uv = [tools.parent / "uv", "pip", "install", "--only-binary", ":all:"]
    ways = {"the folder": ["-m", "pip", "install", PACKAGE],
            "the source archive": ["-m", "pip", "install", archive(tools, folder)]}
    for by, wheel in wheels.items():
        ways[f"wheel by {by}, pip"] = ["-m", "pip", "install", wheel]
        for resolution, name in {"highest": "newest", "lowest-direct": "oldest"}.items():
            ways[f"wheel by {by}, {name}"] = [*uv, "--resolution", resolution, wheel, "grpcio", "protobuf"]
    for number, (way, words) in enumerate(ways.items()):
        there = environment(folder / f"env{number}", python)
        if words[0] == "-m":
            run(there, *words)
        else:
            run(*words, "--python", there)
        scene = f"wheels-{version.replace('.', '_')}-{number}"
        print(f"{version}, {way}: {run(there, '-c', TOUCH, address, scene).strip()}", flush=True)


def main():
    asked = argparse.ArgumentParser()
    asked.add_argument("--build", type=Path)
    asked.add_argument("--service")
    asked.add_argument("--python", action="append")
    asked = asked.parse_args()
    found = pythons(asked.python)
    if not found:
        print("SKIPPED: no Python from 3.11 to 3.14 that makes environments (Debian: python3-venv)")
        sys.exit(77)
    with tempfile.TemporaryDirectory(prefix="tt-wheels-", dir="/tmp") as folder:
        folder = Path(folder)
        tools = environment(folder / "tools", next(iter(found.values())))
        got = subprocess.run([tools, "-m", "pip", "install", "--retries", "1", "build", "uv"], capture_output=True,
                             text=True)
        if got.returncode != 0:
            print(f"SKIPPED: no index of Python packages answers: {got.stderr.strip()[-300:]}")
            sys.exit(77)
        service = contextlib.nullcontext(asked.service) if asked.service else Service(asked.build, folder)
        with service as address:
            for version, python in found.items():
                (folder / version).mkdir()
                try_all(tools, python, version, folder / version, address)
    for version in sorted(set(VERSIONS) - set(found)):
        print(f"not tried: there is no python{version}")


if __name__ == "__main__":
    main()
