"""The package's metadata ask for the grpcio and protobuf that its generated stubs ask for when they are imported."""

import email
import os
import re
import shutil
import subprocess
import sys
import tarfile
import zipfile
from dataclasses import dataclass

import pytest
from conftest import SOURCE

BUILD = "import sys; from hatchling import build; print(getattr(build, 'build_' + sys.argv[1])(sys.argv[2]))"
# A grpcio-tools of this machine's protoc, with the checks that 1.85.1 writes.
GRPC_TOOLS = '''
import pathlib, subprocess, sys
out = next(word.partition("=")[2] for word in sys.argv if word.startswith("--python_out="))
words = [word.replace("--grpc_python_out", "--grpc_out") for word in sys.argv[1:]]
subprocess.run(["{protoc}", "--plugin=protoc-gen-grpc={plugin}", *words], check=True)
for file in pathlib.Path(out).glob("teletact/v1/*_pb2*.py"):
    if file.name.endswith("_grpc.py"):
        checks = """
GRPC_GENERATED_VERSION = '1.85.1'
GRPC_VERSION = grpc.__version__
"""
    else:
        checks = """
# Protobuf Python Version: 7.35.1
_runtime_version.ValidateProtobufRuntimeVersion(
    _runtime_version.Domain.PUBLIC,
    7,
    35,
    1,
    '',
    'teletact/v1/x.proto'
)
"""
    file.write_text(file.read_text() + checks)
'''


@dataclass
class Built:
    required: list[str]
    stubs: dict[str, str]

    def checks(self):
        """What the stubs ask for: grpcio's and protobuf's version, empty where they do not look."""
        text = "".join(self.stubs.values())
        protobuf = re.findall(r"ValidateProtobufRuntimeVersion\(\s*[\w.]+,\s*(\d+),\s*(\d+),\s*(\d+),", text)
        return set(re.findall(r"GRPC_GENERATED_VERSION = '([\d.]+)'", text)), {".".join(found) for found in protobuf}


def build(kind, package, out, path=os.environ["PATH"], modules=""):
    done = subprocess.run([sys.executable, "-c", BUILD, kind, out], cwd=package, capture_output=True, text=True,
                          env={**os.environ, "PATH": str(path), "PYTHONPATH": str(modules)})
    assert done.returncode == 0, done.stderr
    return out / done.stdout.split()[-1]


def required(metadata):
    return sorted(email.message_from_string(metadata.decode()).get_all("Requires-Dist"))


def wheel(*where, **options):
    with zipfile.ZipFile(build("wheel", *where, **options)) as files:
        found = {name: files.read(name) for name in files.namelist()}
    stubs = {name: text.decode() for name, text in found.items() if re.fullmatch(r"teletact/v1/\w+\.py", name)}
    return Built(required(next(text for name, text in found.items() if name.endswith("/METADATA"))), stubs)


@pytest.fixture
def grpc_tools(tmp_path):
    (tmp_path / "grpc_tools").mkdir()
    (tmp_path / "grpc_tools/__init__.py").touch()
    (tmp_path / "grpc_tools/protoc.py").write_text(
        GRPC_TOOLS.format(protoc=shutil.which("protoc"), plugin=shutil.which("grpc_python_plugin")))
    return {"path": tmp_path, "modules": tmp_path}


PACKAGE = SOURCE / "clients" / "python"


def test_stubs_that_look_for_versions_have_them_required(tmp_path, grpc_tools):
    built = wheel(PACKAGE, tmp_path, **grpc_tools)
    assert built.checks() == ({"1.85.1"}, {"7.35.1"})
    assert "grpcio>=1.85.1" in built.required and "protobuf<9,>=7.35.1" in built.required, built.required


def test_stubs_of_protoc_take_what_debian_has(tmp_path):
    built = wheel(PACKAGE, tmp_path)
    assert built.stubs and built.checks() == (set(), set())
    assert "grpcio>=1.51.1" in built.required and "protobuf<6,>=4.21.12" in built.required, built.required


def test_a_source_archive_carries_its_stubs_and_what_they_need(tmp_path, grpc_tools):
    with tarfile.open(build("sdist", PACKAGE, tmp_path, **grpc_tools)) as archive:
        archive.extractall(tmp_path)
    unpacked = next(tmp_path.glob("teletact-*/"))
    built = wheel(unpacked, tmp_path, path=tmp_path)  # nothing there generates
    assert built.checks() == ({"1.85.1"}, {"7.35.1"})
    assert built.required == required((unpacked / "PKG-INFO").read_bytes()) and "grpcio>=1.85.1" in built.required
