"""Functions of laws compile for CUDA devices from the same source, without a driver, and without double
precision in kernels of single precision."""

import subprocess

import pytest
from law_kernels import PRECISIONS, assembler, compiler_lack, functions, kernel_of_function, own_kernel, texts_of

from mpmgis.laws.ground_metric import cosine_squared
from mpmgis.laws.own_law import load_laws

LACK = compiler_lack()
pytestmark = [pytest.mark.thorough, pytest.mark.skipif(bool(LACK), reason=LACK)]
OWN = """
import math
from typing import NamedTuple

class Mine(NamedTuple):
    mu: float = 0.2
    turbulence: float = 900.0

    def basal_stress(self, density, gravity, normal_stress, thickness_normal, speed):
        drag = density * gravity * speed**2 / self.turbulence
        return self.mu * normal_stress + drag if speed > 1e-6 else math.sqrt(self.mu) * normal_stress
"""

each_precision = pytest.mark.parametrize("precision", PRECISIONS)


@each_precision
@pytest.mark.parametrize("function", functions(), ids=lambda function: function.__name__)
def test_functions_of_laws_compile_for_the_device(function, precision, tmp_path):
    for capability, text in texts_of(*kernel_of_function(function, PRECISIONS[precision])).items():
        assert f".target {capability}" in text and ".visible .entry" in text
        assert precision == "float64" or ".f64" not in text
        assemble(text, capability, tmp_path)


@each_precision
def test_own_laws_compile_for_the_device(precision, tmp_path):
    path = tmp_path / "mine.py"
    path.write_text(OWN)
    ((law, _),) = load_laws(path).laws.values()
    for capability, text in texts_of(*own_kernel(law, PRECISIONS[precision])).items():
        assert precision == "float64" or ".f64" not in text
        assemble(text, capability, tmp_path)


def test_all_functions_are_known():
    assert len(functions()) >= 40


@pytest.mark.skipif(not LACK and assembler() is None, reason="no ptxas (pip install nvidia-cuda-nvcc)")
def test_kernels_are_assembled_too(tmp_path):
    texts = texts_of(*kernel_of_function(cosine_squared, PRECISIONS["float64"]))
    assemble(texts["sm_90"], "sm_90", tmp_path)
    assert (tmp_path / "kernel.cubin").stat().st_size


def assemble(text, capability, folder):
    """Assemble `text` for the device; spilled registers would be slow."""
    if assembler() is None:
        return
    source = folder / "kernel.ptx"
    source.write_text(text)
    command = [assembler(), "-v", f"-arch={capability}", source, "-o", source.with_suffix(".cubin")]
    done = subprocess.run(command, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    assert "0 bytes spill stores, 0 bytes spill loads" in done.stderr
