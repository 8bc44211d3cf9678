"""The one place where Warp is configured: device choice, compiler options, launches over threads."""

from __future__ import annotations

import contextlib
import ctypes
import os
import threading
from collections.abc import Iterator
from pathlib import Path
from typing import Any, Literal

import numpy as np

from lithoform.errors import DeviceError


@contextlib.contextmanager
def _silent_native_stderr() -> Iterator[None]:
    """Keep what native code prints to standard error off the terminal (file descriptor 2, not sys.stderr)."""
    try:
        saved = os.dup(2)
    except OSError:  # a process without a standard error
        yield
        return
    try:
        with Path(os.devnull).open("wb") as sink:
            os.dup2(sink.fileno(), 2)
            yield
    finally:
        os.dup2(saved, 2)
        os.close(saved)


def _has_cuda_driver() -> bool:
    try:
        ctypes.CDLL("nvcuda.dll" if os.name == "nt" else "libcuda.so.1")
    except OSError:
        return False
    return True


# Without a driver Warp's native library prints a warning at start-up that nothing can turn off; having no
# GPU is not a fault.  With a driver nothing is hidden.
with contextlib.nullcontext() if _has_cuda_driver() else _silent_native_stderr():
    import warp as wp

    wp.config.log_level = wp.LOG_ERROR
    wp.init()

__all__ = ["MODULE_OPTIONS", "Device", "default_threads", "load", "resolve_device", "shared_array", "to_device", "wp"]

Device = Literal["auto", "cpu", "cuda"]

# No fused multiply-add: with it the compiler fuses where the processor can, and the same recipe would give other
# bits on another processor of the same platform, and on a GPU.  Measured cost: below 10 %.
MODULE_OPTIONS: dict[str, Any] = {
    "enable_backward": False,
    "fuse_fp": False,
    "cpu_compiler_flags": "-march=native -mllvm=-inline-threshold=9000 -ffp-contract=off",
}

_load_lock = threading.Lock()
_loaded: set[tuple[str, str]] = set()


def resolve_device(device: str = "auto") -> str:
    """Warp's name of the device that a request means.

    Parameters
    ----------
    device : {"auto", "cpu", "cuda"}
        "auto" is the first NVIDIA GPU where there is one, else the CPU.

    Returns
    -------
    str
        "cpu" or "cuda:0" (or the "cuda:N" asked for).

    Raises
    ------
    DeviceError
        If a GPU is asked for and there is none, or the name is unknown.
    """
    if device == "cpu":
        return "cpu"
    if device == "auto":
        return "cuda:0" if wp.is_cuda_available() else "cpu"
    if device == "cuda" or device.startswith("cuda:"):
        if not wp.is_cuda_available():
            raise DeviceError(
                "device 'cuda' was asked for, but no NVIDIA GPU is usable here; use --device cpu or auto."
            )
        return "cuda:0" if device == "cuda" else device
    raise DeviceError(f"expected a device of auto, cpu or cuda, got {device!r}.")


def every_gpu(device: str = "auto") -> list[str]:
    """Warp's names of all devices that a request may mean: every NVIDIA GPU for "auto" and "cuda", else the one named.

    Parameters
    ----------
    device : str
        As `resolve_device`, which says what is raised.
    """
    first = resolve_device(device)
    if first == "cpu" or device.startswith("cuda:"):
        return [first]
    return [f"cuda:{k}" for k in range(wp.get_cuda_device_count())]


def load(module: Any, device: str) -> None:
    """Compile (or fetch from the cache) a Warp module once, before threads launch its kernels."""
    key = (module.name, device)
    if key not in _loaded:
        with _load_lock:
            if key not in _loaded:
                wp.load_module(module, device=device)
                _loaded.add(key)


def to_device(array: np.ndarray, dtype: Any, device: str) -> Any:
    """Warp array with a copy of a NumPy array."""
    return wp.array(array, dtype=dtype, device=device)


def shared_array(array: np.ndarray, dtype: Any) -> Any:
    """Warp array on the CPU that shares the memory of a contiguous NumPy array; only for reading by kernels."""
    return wp.array(array, dtype=dtype, device="cpu", copy=False)


def default_threads() -> int:
    """Number of processors that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else (os.cpu_count() or 1)
