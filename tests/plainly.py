"""Runs Python with the plainest instructions that the libraries can be told to use.

    python tests/plainly.py -m pytest tests/planning/test_laws_place.py

Processors differ in the last bit of what they compute, by their instructions and by the kernels that
libraries choose for them. Laws that hold under the plainest ones, too, do not hang on that.
"""

from __future__ import annotations

import os
import sys


def plainest() -> dict[str, str]:
    """The variables that say so: of OpenBLAS, of what the installed numpy chooses at run time, of numba."""
    from numpy._core._multiarray_umath import __cpu_dispatch__, __cpu_features__

    return {
        "OPENBLAS_CORETYPE": "Prescott",
        "NPY_DISABLE_CPU_FEATURES": " ".join(name for name in __cpu_dispatch__ if __cpu_features__.get(name)),
        "NUMBA_CPU_NAME": "generic",
        "NUMBA_CPU_FEATURES": "",
    }


if __name__ == "__main__":
    os.execve(sys.executable, [sys.executable, *sys.argv[1:]], os.environ | plainest())
