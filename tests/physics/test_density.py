"""Today's stream: against galpy for one impact, against brute force for many, invariants."""

import numpy as np
import pytest

from streamdash.config import Accuracy, Perturbers
from streamdash.engine.density import perturbed_stream, stream_profile
from streamdash.engine.impacts import COLUMNS, Impacts, ImpactsError, sample_impacts
from tests.physics.reference import march
from tests.physics.test_kicks import CASES, hit_galpys, one

THETA = np.linspace(0.03, 0.987, 60)


def test_no_impacts_is_the_smooth_stream(geometry):
    stream = perturbed_stream(geometry, Impacts.none(), THETA)
    assert (stream.q_rho == 1).all()
    assert (stream.omega == stream.omega_smooth).all()


def test_vanishing_impacts_give_the_smooth_stream_by_integration(geometry):
    """The quadrature itself, edges of the support included, is exact to 2·10⁻⁴."""
    weak = one(geometry, 20, 0.3, 0.1, (10.0, 100.0, 50.0), 1e-3, 0.01)
    stream = perturbed_stream(geometry, weak, THETA)
    assert stream.q_rho.values == pytest.approx(1, abs=2e-4)
    assert stream.omega.values == pytest.approx(stream.omega_smooth.values, rel=5e-5)


def galpy_by_even_sum(gap, angle):
    """Density from galpy's own p(Ω, θ), by the rectangle rule."""
    sigma = np.sqrt(gap._sortedSigOEig[2])
    omega = gap._meandO + sigma * np.linspace(-60, 60, 400_001)
    return gap.pOparapar(omega, angle).sum() * (omega[1] - omega[0]) / np.sqrt(2 * np.pi)


@pytest.mark.parametrize("profile", ["hernquist", "plummer"])
@pytest.mark.parametrize("case", CASES, ids=["near-recent", "small", "old"])
def test_one_impact_equals_galpys_gap(geometry, gap_at, profile, case):
    k, theta, b, w, mass, r_s = case
    gap = hit_galpys(gap_at(k), case, profile)
    angles = np.linspace(0.05, 0.95, 25)
    ours = perturbed_stream(geometry, one(geometry, k, theta, b, w, mass, r_s, profile), angles)
    smooth = ours.smooth.values
    exact = np.array([gap._density_par(a, approx=False) for a in angles]) / np.sqrt(2 * np.pi)
    # Its adaptive rule can step over a narrow strand of stars altogether, at one angle in
    # a few dozen; its integrand summed evenly shows that the strand is there.
    misses = np.abs(ours.density.values - exact) > 1e-3
    assert misses.sum() <= 2
    for angle, density in zip(angles[misses], ours.density.values[misses], strict=True):
        assert density == pytest.approx(galpy_by_even_sum(gap, angle), abs=2e-3)
    # Its default takes kicks as linear between its points.
    default = np.array([gap._density_par(a) for a in angles])
    assert np.abs((ours.density.values - default) / smooth).max() < 2e-2
    assert np.abs(ours.q_rho.values - 1).max() > 5e-3


@pytest.mark.parametrize("mass_range", ["1e3-1e5", "1e5-1e9", "1e7-1e9"])
@pytest.mark.parametrize("seed", [1, 2])
def test_worst_point_of_many_impacts_against_brute_force(geometry, mass_range, seed):
    impacts = sample_impacts(geometry, Perturbers(mass_range=mass_range), np.random.default_rng(seed))
    angles = np.linspace(0.03, 0.987, 17)
    density, omega = stream_profile(geometry, impacts, angles)
    brute, brute_omega = march(geometry, impacts, angles, steps=2500, spacing=2e-5)
    smooth = geometry.smooth_density(angles)
    assert np.abs((density - brute) / smooth).max() < 2e-3
    # In units of the smooth stream's, like the density: the mean itself can come near zero.
    assert np.abs((omega - brute_omega) / geometry.smooth_omega(angles)).max() < 5e-4


def test_impacts_beyond_the_length_are_computed_as_well(geometry):
    """By brute force: where the stream has less than a fifth of its density left, impacts still count."""
    k = 45
    theta = 1.2 * float(geometry.length_at(geometry.times[k]))
    impact = one(geometry, k, theta, 0.1, (10.0, 80.0, -60.0), 1e7, 0.33)
    angles = np.linspace(0.5, 1.3, 17)
    density, _ = stream_profile(geometry, impact, angles)
    brute, _ = march(geometry, impact, angles, steps=2500, spacing=2e-5)
    assert np.abs(density - brute).max() < 2e-3
    assert np.abs(density - geometry.smooth_density(angles)).max() > 5e-3


def test_order_of_impacts_does_not_matter(geometry):
    impacts = sample_impacts(geometry, Perturbers(), np.random.default_rng(4))
    order = np.random.default_rng(0).permutation(len(impacts))
    shuffled = Impacts(*(getattr(impacts, c)[order] for c in COLUMNS))
    a, b = (perturbed_stream(geometry, i, THETA).density.values for i in (impacts, shuffled))
    assert a == pytest.approx(b, rel=1e-8)


def test_two_half_kicks_are_one(geometry):
    whole = one(geometry, 12, 0.4, 0.2, (50.0, -90.0, 120.0), 2e7, 0.47)
    half = one(geometry, 12, 0.4, 0.2, (50.0, -90.0, 120.0), 1e7, 0.47)
    twice = Impacts(*(np.repeat(getattr(half, c), 2) for c in COLUMNS))
    a, b = (perturbed_stream(geometry, i, THETA).q_rho.values for i in (whole, twice))
    assert np.abs(a - b).max() < 1e-3


def test_profile_at_one_angle_does_not_depend_on_the_others(geometry):
    impacts = sample_impacts(geometry, Perturbers(), np.random.default_rng(6))
    together, _ = stream_profile(geometry, impacts, THETA)
    alone, _ = stream_profile(geometry, impacts, THETA[17:18])
    assert alone[0] == together[17]


def test_finer_settings_converge(geometry):
    """Each setting alone, four times finer: the worst point of most streams moves by less than 10⁻³ of ρ̄,
    of none by the engine's error."""
    smooth = geometry.smooth_density(THETA)
    for mass_range in ("1e3-1e5", "1e5-1e9"):
        moved = []
        for seed in range(9, 14):
            impacts = sample_impacts(geometry, Perturbers(mass_range=mass_range), np.random.default_rng(seed))
            base, _ = stream_profile(geometry, impacts, THETA)
            finer = [Accuracy(**{name: value / 4}) for name, value in Accuracy()]
            fine = [stream_profile(geometry, impacts, THETA, accuracy=accuracy)[0] for accuracy in finer]
            moved.append([np.abs((profile - base) / smooth).max() for profile in fine])
        assert (np.median(moved, axis=0) < 1e-3).all(), mass_range
        assert np.max(moved) < 2e-3, mass_range


def test_refuses_angles_and_impacts_off_the_stream(geometry):
    impact = one(geometry, 12, 0.4, 0.2, (50.0, -90.0, 120.0), 2e7, 0.47)
    with pytest.raises(ValueError, match="positive angles"):
        perturbed_stream(geometry, impact, np.array([-0.1, 0.2]))
    with pytest.raises(ImpactsError, match="row 1, column theta"):
        perturbed_stream(geometry, one(geometry, 12, 2.5, 0.2, (1, 2, 3), 1e6, 0.1), THETA)


def test_massive_flybys_conserve_stars(geometry):
    """Far more than one dispersion of kick: stars move along the stream, none vanish."""
    impact = one(geometry, 10, 0.5, 0.3, (10.0, 60.0, 40.0), 3e8, 1.8)
    angles = np.linspace(1e-4, 2.8, 4001)
    density, _ = stream_profile(geometry, impact, angles)
    kicked = np.trapezoid(density, angles)
    smooth = np.trapezoid(geometry.smooth_density(angles), angles)
    assert np.abs(density - geometry.smooth_density(angles)).max() > 0.2
    assert kicked == pytest.approx(smooth, rel=0.02)
