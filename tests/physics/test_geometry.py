"""The smooth stream against galpy and the published numbers of the GD-1-like model."""

import numpy as np
import pytest

from streamdash.config import StreamModel
from streamdash.engine.geometry import Geometry
from streamdash.simulation.geometry import compute_geometry


def test_numbers_of_the_default_stream(geometry):
    """The published digits, and what galpy's last digits differ by between processors."""
    assert geometry.mean_omega == pytest.approx(0.00341944, rel=1e-5)
    assert geometry.sigma_omega == pytest.approx(0.00056991, rel=2e-5)
    assert geometry.t_disrupt == pytest.approx(253.1213, abs=5e-5)
    assert geometry.length == pytest.approx(0.98694, rel=1e-5)


@pytest.mark.parametrize(("theta", "ell"), [(0, 161.12), (0.231, 191.12), (0.577, 217.83), (0.981, 234.71)])
def test_longitudes_of_the_track(geometry, theta, ell):
    assert np.interp(theta, geometry.track_theta, geometry.track_ell) == pytest.approx(ell, abs=0.02)


@pytest.mark.parametrize(("theta", "phi1"), [(0.058, -28.9), (0.75, -87.3)])
def test_gd1_longitudes_of_the_track(geometry, theta, phi1):
    assert np.interp(theta, geometry.track_theta, geometry.track_longitude) == pytest.approx(phi1, abs=0.06)


def test_smooth_density_frequency_and_length_are_galpys(smooth_of_today):
    """Both sides from galpy run here, so that only our formulas can differ."""
    geometry, smooth = smooth_of_today
    theta = np.linspace(0.01, 1.3, 40)
    assert geometry.smooth_density(theta) == pytest.approx([smooth.density_par(t) for t in theta], rel=1e-9)
    omega = [smooth.meanOmega(t, oned=True, use_physical=False) for t in theta]
    assert geometry.smooth_omega(theta) == pytest.approx(omega, rel=1e-9)
    for time in (0.0, 100.0):
        galpy_length = smooth.length(tdisrupt=smooth._tdisrupt - time)
        assert geometry.length_at(time) == pytest.approx(galpy_length, rel=1e-6)


def test_survives_storage(geometry):
    again = Geometry.from_dataset(geometry.to_dataset(), geometry.stream)
    assert (again.tables == geometry.tables).all()
    broken = geometry.to_dataset().drop_vars("node_jac")
    with pytest.raises(ValueError, match="node_jac"):
        Geometry.from_dataset(broken, geometry.stream)


def test_trailing_arm_and_other_ages(tmp_path):
    stream = StreamModel(arm="trailing", age_gyr=5.0, times_gyr=(1.0,))
    geometry = compute_geometry(stream, workers=1)
    assert geometry.t_disrupt == pytest.approx(5 / 0.035556, rel=1e-4)
    # A dispersion that falls as 1/age keeps the length; the trailing arm is a mirror image
    # only to first order.
    assert geometry.length == pytest.approx(0.98694, rel=0.03)
    assert np.isfinite(geometry.tables).all()
