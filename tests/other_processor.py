"""What another processor computes, on this one: older or fewer instructions, so other last digits.

``python -m tests.other_processor older tests/physics`` runs pytest so; its options may follow.
"""

from __future__ import annotations

import os
import platform
import sys

WITHOUT_512 = "X86_V4 AVX512_ICL AVX512_SPR"
PROCESSORS = {
    "haswell": {
        "NPY_DISABLE_CPU_FEATURES": WITHOUT_512,
        "OPENBLAS_CORETYPE": "Haswell",
        "NUMBA_CPU_NAME": "haswell",
    },
    "older": {
        "NPY_DISABLE_CPU_FEATURES": f"X86_V3 {WITHOUT_512}",
        "OPENBLAS_CORETYPE": "Nehalem",
        "NUMBA_CPU_NAME": "generic",
        "GLIBC_TUNABLES": "glibc.cpu.hwcaps=-AVX2,-FMA,-AVX512F,-FMA4,-AVX",
    },
}
"""What makes NumPy, OpenBLAS, numba and the C library (so galpy's C code) compute as a processor does."""


def environment(processor: str) -> dict[str, str]:
    """The environment of a process that is to compute as `processor` does; x86-64 alone can pretend."""
    if platform.machine() != "x86_64":
        raise SystemExit(f"other_processor: only x86-64 can pretend to be another, not {platform.machine()}")
    return {**os.environ, **PROCESSORS[processor]}


if __name__ == "__main__":
    if len(sys.argv) < 2 or sys.argv[1] not in PROCESSORS:
        raise SystemExit(f"usage: python -m tests.other_processor {'|'.join(PROCESSORS)} [options of pytest]")
    os.execve(sys.executable, [sys.executable, "-m", "pytest", *sys.argv[2:]], environment(sys.argv[1]))
