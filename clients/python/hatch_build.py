"""Generates teletact/v1 from the contract, by protoc and grpc_python_plugin (Debian: protobuf-compiler,
protobuf-compiler-grpc), else by grpcio-tools, and states the grpcio and protobuf that such stubs need.

A source archive carries its stubs: what is built of it needs no generator, and states what the archive does.
"""

import atexit
import functools
import importlib.util
import pathlib
import re
import shutil
import subprocess
import sys
import tempfile

from hatchling.builders.hooks.plugin.interface import BuildHookInterface
from hatchling.metadata.plugin.interface import MetadataHookInterface


class Stubs(BuildHookInterface):
    PLUGIN_NAME = "custom"

    def dependencies(self):
        return [] if carried(self.root) or protoc_with_plugin() else ["grpcio-tools"]

    def initialize(self, version, build_data):
        if version == "editable" or carried(self.root):
            return
        folder = stubs(self.root)
        base = "src/" if self.target_name == "sdist" else ""
        for file in sorted(folder.rglob("*.py*")):
            build_data["force_include"][str(file)] = base + str(file.relative_to(folder))


class Bounds(MetadataHookInterface):
    PLUGIN_NAME = "custom"

    def update(self, metadata):
        metadata["dependencies"] = [*self.config["dependencies"], *bounds(stubs(self.root))]


def carried(root):
    return (pathlib.Path(root) / "src/teletact/v1").is_dir()


@functools.cache
def stubs(root):
    """The folder that has teletact/v1 in it; one that is generated goes with this process."""
    if carried(root):
        return pathlib.Path(root) / "src"
    contract = pathlib.Path(root).parent.parent / "proto"
    if not contract.is_dir():
        raise RuntimeError("the contract is missing: build in a checkout of teletact, or from a source archive")
    folder = tempfile.mkdtemp()
    atexit.register(shutil.rmtree, folder)
    generate(contract, folder)
    return pathlib.Path(folder)


def generate(contract, out):
    protos = sorted(str(proto) for proto in contract.glob("teletact/v1/*.proto"))
    options = ["-I", str(contract), f"--python_out={out}", f"--pyi_out={out}"]
    if plugin := protoc_with_plugin():
        command = ["protoc", *options, f"--grpc_out={out}", f"--plugin=protoc-gen-grpc={plugin}"]
    elif importlib.util.find_spec("grpc_tools"):
        command = [sys.executable, "-m", "grpc_tools.protoc", *options, f"--grpc_python_out={out}"]
    else:
        raise RuntimeError("nothing generates the stubs: apt install protobuf-compiler protobuf-compiler-grpc, "
                           "or pip install grpcio-tools")
    subprocess.run([*command, *protos], check=True)


def protoc_with_plugin():
    return shutil.which("protoc") and shutil.which("grpc_python_plugin")


def bounds(folder):
    """What the stubs ask for when they are imported: at least their generator's grpcio and protobuf; and, by protobuf's
    promise, at most its next major version. Old generators state nothing: the stubs of grpcio's before 1.63 and of
    protobuf's from 4.21 to 4.24 need no newer ones than Debian 12 has."""
    text = "".join(file.read_text() for file in sorted(folder.glob("teletact/v1/*_pb2*.py")))
    grpcio = re.search(r"^GRPC_GENERATED_VERSION = '(.+)'", text, re.MULTILINE)
    protobuf = re.search(r"^# Protobuf Python Version: (.+)", text, re.MULTILINE)
    least = protobuf[1] if protobuf else "4.21.12"
    return [f"grpcio>={grpcio[1] if grpcio else '1.51.1'}", f"protobuf>={least},<{int(least.split('.')[0]) + 2}"]
