"""Whether there is a GPU that can be used; nothing of CUDA is imported before it is asked for."""

from __future__ import annotations

from importlib.util import find_spec

from numba import config

#: Characters of what a driver says that are repeated.
_SAID = 300


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
    except Exception as error:  # whatever is wrong with an installation is told, not raised
        return f"numba-cuda cannot be imported: {_words(error)}"
    try:
        found = cuda.is_available()
        if found and len(cuda.gpus):
            return None
        reason = cuda.cuda_error()
    except Exception as error:  # of the driver, of whatever kind
        found, reason = False, error
    if not found and reason is None:
        return "NVIDIA's compiler is not found (pip install 'gridfold[cuda]')"
    return "no NVIDIA GPU or driver is found" + (f": {_words(reason)}" if reason else "")


def _words(reason: object) -> str:
    return " ".join(str(reason).split())[:_SAID]
