"""Settings shared by all benchmarks."""

from __future__ import annotations

import numba
import numpy
import pytest


def pytest_benchmark_update_machine_info(config: pytest.Config, machine_info: dict) -> None:
    """Record the versions of what compiles and runs the engine beside the machine's own description."""
    machine_info["numba"] = numba.__version__
    machine_info["numpy"] = numpy.__version__


def pytest_report_header(config: pytest.Config) -> str:
    """Say with what the times below were taken."""
    return (
        f"engine: numba {numba.__version__}, numpy {numpy.__version__}, "
        f"{numba.get_num_threads()} threads available, times are of one thread unless said"
    )
