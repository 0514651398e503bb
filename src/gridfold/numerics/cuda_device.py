"""Whether there is a GPU that can be used; nothing of CUDA is imported before it is asked for."""

from __future__ import annotations

from importlib.util import find_spec

from numba import config


def simulated() -> bool:
    """Whether Numba's simulator stands for a GPU (``NUMBA_ENABLE_CUDASIM=1``)."""
    return bool(vars(config)["ENABLE_CUDASIM"])


def why_no_gpu() -> str | None:
    """Why no GPU can be used, in words; None if one can, or if the simulator stands for it."""
    if simulated():
        return None
    if find_spec("numba_cuda") is None:
        return "numba-cuda is not installed (pip install 'gridfold[cuda]')"
    try:
        from numba import cuda

        if cuda.is_available():
            return None
        reason = cuda.cuda_error()
    except Exception as error:  # whatever is wrong with an installation is told, not raised
        reason = error
    text = " ".join(str(reason or "").split())
    return "no NVIDIA GPU or driver is found" + (f": {text}" if text else "")
