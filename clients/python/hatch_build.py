"""Generates teletact/v1 into a wheel, from the contract: by protoc and grpc_python_plugin (Debian: protobuf-compiler,
protobuf-compiler-grpc), else by grpcio-tools."""

import importlib.util
import pathlib
import shutil
import subprocess
import sys
import tempfile

from hatchling.builders.hooks.plugin.interface import BuildHookInterface


class Stubs(BuildHookInterface):
    PLUGIN_NAME = "custom"

    def initialize(self, version, build_data):
        if self.target_name != "wheel" or version == "editable":
            return
        here = pathlib.Path(self.root)
        # Beside the package in a source archive, else in the checkout.
        contract = next((folder for folder in (here / "proto", here.parent.parent / "proto") if folder.is_dir()), None)
        if contract is None:
            raise RuntimeError("the contract is missing: build in a checkout of teletact, or from a source archive")
        self._folder = tempfile.TemporaryDirectory()
        out = pathlib.Path(self._folder.name)
        generate(contract, out)
        for file in sorted(out.rglob("*.py*")):
            build_data["force_include"][str(file)] = str(file.relative_to(out))

    def finalize(self, version, build_data, artifact_path):
        if hasattr(self, "_folder"):
            self._folder.cleanup()


def generate(contract, out):
    protos = sorted(str(proto) for proto in contract.glob("teletact/v1/*.proto"))
    options = ["-I", str(contract), f"--python_out={out}", f"--pyi_out={out}"]
    plugin = shutil.which("grpc_python_plugin")
    if shutil.which("protoc") and plugin:
        command = ["protoc", *options, f"--grpc_out={out}", f"--plugin=protoc-gen-grpc={plugin}"]
    elif importlib.util.find_spec("grpc_tools"):
        command = [sys.executable, "-m", "grpc_tools.protoc", *options, f"--grpc_python_out={out}"]
    else:
        raise RuntimeError("nothing generates the stubs: apt install protobuf-compiler protobuf-compiler-grpc, "
                           "or pip install grpcio-tools and build with --no-build-isolation")
    subprocess.run([*command, *protos], check=True)
