"""Planning's laws are held to once more under the plainest kernels: those are what is computed with."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

PROBE = """
import json
import numpy
from numba.core.registry import cpu_target
from numpy._core._multiarray_umath import __cpu_dispatch__, __cpu_features__
from threadpoolctl import threadpool_info
used = [name for name in __cpu_dispatch__ if __cpu_features__[name]]
blas = [pool["architecture"] for pool in threadpool_info() if "numpy" in pool["filepath"]]
codegen = cpu_target.target_context.codegen()
print(json.dumps([used, blas, codegen._get_host_cpu_name()]))
"""


def test_numpy_its_linear_algebra_and_numba_compute_plainly() -> None:
    command = [sys.executable, str(Path(__file__).with_name("plainly.py")), "-c", PROBE]
    process = subprocess.run(command, capture_output=True, text=True, check=True)
    used, blas, numba_cpu = json.loads(process.stdout)
    assert used == [], "numpy still chooses instructions of this processor"
    assert set(blas) <= {"Prescott", "Katmai", "ARMV8"}  # the plainest that it was built with
    assert numba_cpu == "generic"
