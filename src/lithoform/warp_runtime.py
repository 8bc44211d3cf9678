"""The one place where Warp is configured: device choice, compiler options, launches over threads."""

from __future__ import annotations

import os
import threading
import warnings
from typing import Any, Literal

import numpy as np

from lithoform.errors import DeviceError

with warnings.catch_warnings():
    # Warp announces a missing NVIDIA driver as a warning when it starts; having no GPU is not a fault here.
    warnings.simplefilter("ignore")
    import warp as wp

    wp.config.quiet = True
    wp.config.log_level = wp.LOG_ERROR
    wp.init()

__all__ = ["Device", "MODULE_OPTIONS", "load", "resolve_device", "to_device", "wp"]

Device = Literal["auto", "cpu", "cuda"]

# -ffp-contract=off: without it the compiler fuses multiplications and additions where the processor can,
# and the same recipe would give other bits on another processor of the same platform.  Measured cost: below 10 %.
MODULE_OPTIONS: dict[str, Any] = {
    "enable_backward": False,
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
            raise DeviceError("device 'cuda' was asked for, but no NVIDIA GPU is usable here; use --device cpu or auto.")
        return "cuda:0" if device == "cuda" else device
    raise DeviceError(f"expected a device of auto, cpu or cuda, got {device!r}.")


def load(module: Any, device: str) -> None:
    """Compile (or fetch from the cache) a Warp module once, before threads launch its kernels."""
    key = (module.name, device)
    if key not in _loaded:
        with _load_lock:
            if key not in _loaded:
                wp.load_module(module, device=device)
                _loaded.add(key)


def to_device(array: np.ndarray, dtype: Any, device: str) -> Any:
    """Warp array of a NumPy array; on the CPU it shares the memory."""
    if device == "cpu":
        return wp.from_numpy(np.ascontiguousarray(array), dtype=dtype, device=device)
    return wp.array(array, dtype=dtype, device=device)


def default_threads() -> int:
    """Number of processors that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else (os.cpu_count() or 1)
