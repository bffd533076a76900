"""galpy's own streams with a gap, for comparison: seconds each, so made once and shared."""

from functools import cache

import pytest

from streamdash.config import StreamModel
from streamdash.engine.galpy_streams import galpy_gap, galpy_stream
from streamdash.engine.geometry import smooth_geometry


@pytest.fixture(scope="session")
def smooth_of_today():
    """The default stream as galpy computes it here: our smooth geometry of it, and galpy's object."""
    return smooth_geometry(StreamModel()), galpy_stream(StreamModel(), compiled=True)


@pytest.fixture(scope="session")
def gap_at(geometry):
    """The `streamgapdf` at impact time k; tests set their own impact on it."""

    @cache
    def make(k):
        gap = galpy_gap(geometry.stream, geometry.stream.impact_times_gyr[k])
        gap._higherorderTrack = False  # as galpy's default; set only by its full set-up
        return gap

    return make
