"""Streams do not depend on what else is installed: galpy takes other constants where astropy is."""

import subprocess
import sys

import pytest

PRINTED = """
import sys
if sys.argv[1] == "without":
    sys.modules["astropy"] = None  # importing it fails, as where it is not installed
from galpy.util import conversion
from streamdash.engine.galpy_streams import R0_KPC, V0_KMS, time_unit_gyr
from streamdash.engine.impulse import gravity
print(repr(time_unit_gyr()), repr(gravity()))
print(float(conversion.time_in_Gyr(V0_KMS, R0_KPC)), 1 / float(conversion.mass_in_msol(V0_KMS, R0_KPC)))
"""


def printed(astropy: str) -> list[list[float]]:
    """Time unit and gravity, the engine's and galpy's own, of a process with or without astropy."""
    run = subprocess.run([sys.executable, "-c", PRINTED, astropy], capture_output=True, text=True, check=True)
    return [[float(word) for word in line.split()] for line in run.stdout.splitlines()]


def test_constants_are_the_same_with_astropy_and_without():
    (ours_with, galpys_with), (ours_without, galpys_without) = printed("with"), printed("without")
    assert ours_with == ours_without
    assert ours_without == pytest.approx(galpys_without, rel=1e-14, abs=0)
    # Where these agree the engine needs no constants of its own.
    assert galpys_with[1] != pytest.approx(galpys_without[1], rel=1e-4, abs=0)
