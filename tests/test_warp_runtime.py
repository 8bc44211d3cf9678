"""One source for CPU and CUDA: every kernel compiles for both, and the choice of the device is plain."""

from __future__ import annotations

import subprocess
import sys

import numpy as np
import pytest

from lithoform import DeviceError, face_integrals, intersections, noise, radius, soundness
from lithoform.dem import gjk, integrate, jkr, narrowphase
from lithoform.warp_runtime import default_threads, every_gpu, resolve_device, shared_array, to_device, wp

KERNEL_MODULES = [face_integrals, intersections, noise, radius, soundness, gjk, integrate, jkr, narrowphase]


@pytest.mark.skipif(sys.platform == "darwin", reason="Warp has no CUDA compiler on macOS")
@pytest.mark.parametrize("module", KERNEL_MODULES, ids=lambda module: module.__name__.partition(".")[2])
def test_every_kernel_compiles_for_an_nvidia_gpu(module, tmp_path):
    """Warp brings its own CUDA compiler: no GPU is needed to make the machine code of one (compute capability 9.0)."""
    wp.compile_aot_module(module, arch=[90], module_dir=tmp_path)
    (binary,) = tmp_path.glob("*.sm90.cubin")
    assert binary.stat().st_size > 1000
    assert binary.read_bytes()[:4] == b"\x7fELF"


def test_device_names():
    assert resolve_device("cpu") == "cpu"
    assert resolve_device("auto") == ("cuda:0" if wp.is_cuda_available() else "cpu")
    with pytest.raises(DeviceError, match="auto, cpu or cuda"):
        resolve_device("gpu")


@pytest.mark.skipif(wp.is_cuda_available(), reason="there is a GPU here")
def test_a_gpu_that_is_not_there_is_a_clear_error():
    with pytest.raises(DeviceError, match="--device cpu or auto"):
        resolve_device("cuda")


def test_starting_warp_says_nothing():
    code = "import lithoform.warp_runtime"
    done = subprocess.run([sys.executable, "-W", "error", "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout + done.stderr == ""


def test_shared_arrays_share_and_copies_do_not():
    array = np.arange(6.0).reshape(2, 3)
    shared, copy = shared_array(array, wp.vec3d), to_device(array, wp.vec3d, "cpu")
    array[0, 0] = 9.0
    assert shared.numpy()[0, 0] == 9.0
    assert copy.numpy()[0, 0] == 0.0


def test_there_is_at_least_one_thread():
    assert default_threads() >= 1


def test_every_gpu_is_named(monkeypatch):
    assert every_gpu("cpu") == ["cpu"]
    monkeypatch.setattr(wp, "is_cuda_available", lambda: True)
    monkeypatch.setattr(wp, "get_cuda_device_count", lambda: 3)
    assert every_gpu("auto") == every_gpu("cuda") == ["cuda:0", "cuda:1", "cuda:2"]
    assert every_gpu("cuda:1") == ["cuda:1"]
    monkeypatch.setattr(wp, "is_cuda_available", lambda: False)
    assert every_gpu("auto") == ["cpu"]
