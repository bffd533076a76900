"""GD-1 and Palomar 5 as shipped, against galpy and the published numbers of their models."""

from functools import cache

import numpy as np
import pytest

from streamdash.config import Perturbers
from streamdash.engine.density import perturbed_stream
from streamdash.engine.galpy_streams import R0_KPC, V0_KMS, galpy_gap, galpy_stream, progenitor_radius
from streamdash.engine.geometry import smooth_geometry
from streamdash.engine.impacts import (
    expected_impacts,
    mass_decades,
    sample_impacts,
    scale_radius,
    subhalo_count,
)
from streamdash.simulation.geometry import StreamError, load_geometry
from streamdash.streams import named_stream, window_of
from streamdash.survey import sky
from streamdash.survey.design import default_design, published_design
from tests.physics.test_kicks import hit_galpys, one

ARMS = [("gd1", "leading"), ("gd1", "trailing"), ("pal5", "trailing"), ("pal5", "leading")]


@pytest.fixture(scope="session")
def shipped():
    """Geometry of an arm from the shipped cache."""
    return cache(lambda name, arm: load_geometry(named_stream(name).arms[arm]))


@pytest.fixture(scope="session")
def galpys():
    """galpy's own smooth stream of an arm: some 16 core seconds."""
    return cache(lambda name, arm: galpy_stream(named_stream(name).arms[arm]))


# --- published numbers ------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("name", "arm", "first", "last"),
    [
        ("gd1", "leading", -40.0, -99.5),
        ("gd1", "trailing", -40.0, 15.0),
        ("pal5", "trailing", -0.2, 28.4),
        ("pal5", "leading", 0.2, -19.1),
    ],
)
def test_arms_reach_from_and_to_the_published_longitudes(shipped, name, arm, first, last):
    geometry = shipped(name, arm)
    ends = sky.from_theta(geometry, [0.0, geometry.length], geometry.frame.longitude)
    assert ends == pytest.approx([first, last], abs=0.5 if name == "gd1" else 0.06)


@pytest.mark.parametrize(("arm", "degrees"), [("trailing", 35.5), ("leading", 57.3)])
def test_palomar_5_is_as_long_along_its_track_as_published(shipped, arm, degrees):
    """As galpy measures it: a degree of Galactic longitude counts in full at any latitude."""
    geometry = shipped("pal5", arm)
    keep = geometry.track_theta <= geometry.length
    steps = np.hypot(np.diff(geometry.track_ell[keep]), np.diff(geometry.track_b[keep]))
    assert steps.sum() == pytest.approx(degrees, abs=0.1)


@pytest.mark.parametrize(("name", "peri", "apo"), [("gd1", 13.5, 23.5), ("pal5", 7.34, 19.04)])
def test_orbits_reach_the_published_radii(name, peri, apo):
    model = named_stream(name).arm()
    radius = progenitor_radius(model, np.linspace(0, model.age_gyr, 20_001))
    assert (radius.min(), radius.max()) == pytest.approx((peri, apo), abs=0.06)


def test_palomar_5_drifts_at_the_published_frequency(shipped):
    assert shipped("pal5", "trailing").mean_omega == pytest.approx(0.0184, abs=5e-5)


# --- galpy ------------------------------------------------------------------------------------


@pytest.mark.slow
@pytest.mark.parametrize(("name", "arm"), [("gd1", "leading"), ("pal5", "trailing")])
def test_smooth_stream_is_galpys(shipped, galpys, name, arm):
    """With galpy's own actions and angles, not the compiled ones; shipped on another processor."""
    geometry, smooth = shipped(name, arm), galpys(name, arm)
    assert geometry.mean_omega == pytest.approx(smooth._meandO, rel=1e-4)
    assert geometry.sigma_omega == pytest.approx(np.sqrt(smooth._sortedSigOEig[2]), rel=1e-4)
    assert geometry.length == pytest.approx(smooth.length(), rel=1e-4)
    ell, b, dist = smooth._interpolatedObsTrackLB[:, :3].T
    theta = smooth._interpolatedThetasTrack
    keep = theta < geometry.length
    for ours, theirs in (
        (geometry.track_ell, np.degrees(np.unwrap(np.radians(ell)))),
        (geometry.track_b, b),
        (geometry.track_dist, dist),
    ):
        assert np.interp(theta[keep], geometry.track_theta, ours) == pytest.approx(theirs[keep], abs=0.02)


@pytest.mark.slow
@pytest.mark.parametrize(("name", "arm"), [("gd1", "leading"), ("pal5", "trailing")])
def test_expected_impacts_are_galpys(shipped, galpys, name, arm):
    perturbers = Perturbers(mass_range=(1e6, 1e9), X=10)
    total = sum(
        galpys(name, arm).subhalo_encounters(
            sigma=perturbers.sigma_h / V0_KMS,
            nsubhalo=subhalo_count(low, high, -2),
            bmax=10 * scale_radius(np.sqrt(low * high), perturbers) / R0_KPC,
        )
        for low, high in mass_decades(perturbers.mass_range)
    )
    assert expected_impacts(shipped(name, arm), perturbers) == pytest.approx(total, rel=1e-3)


@pytest.mark.slow
@pytest.mark.parametrize(("name", "arm"), ARMS)
def test_one_impact_equals_galpys_gap(shipped, name, arm):
    """The shipped track and Jacobian, kick and density, against galpy's own of one flyby."""
    geometry, k = shipped(name, arm), 52
    stream = geometry.stream
    there = float(geometry.length_at(geometry.times[k]))
    case = (k, 0.5 * there, 0.1, (30.0, 150.0, -80.0), 3e7, 0.58)
    gap = galpy_gap(stream, stream.impact_times_gyr[k])
    gap._higherorderTrack = False
    sign = 1 if arm == "leading" else -1
    hit_galpys(gap, (k, sign * case[1], *case[2:]), "hernquist")
    angles = np.linspace(*window_of(stream).theta, 40)
    ours = perturbed_stream(geometry, one(geometry, *case), angles)
    exact = np.array([gap._density_par(a, approx=False) for a in angles]) / np.sqrt(2 * np.pi)
    apart = np.abs(ours.density.values - exact)
    # galpy's adaptive rule can step over a narrow strand of stars at an angle or two.
    assert np.sort(apart)[-3] < 2e-3
    assert np.abs(ours.q_rho.values - 1).max() > 0.02


# --- arms -------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", ["gd1", "pal5"])
def test_one_population_hits_both_arms_alike(shipped, name):
    """The rate is the population's; arms differ by their length and width, which are nearly the same."""
    leading, trailing = (
        expected_impacts(shipped(name, arm), Perturbers()) for arm in ("leading", "trailing")
    )
    assert leading == pytest.approx(trailing, rel=0.05)


@pytest.mark.parametrize(("name", "arm"), ARMS)
def test_every_arm_is_hit_within_its_own_stretch(shipped, name, arm):
    geometry = shipped(name, arm)
    impacts = sample_impacts(geometry, Perturbers(rate_factor=3), np.random.default_rng(5))
    assert len(impacts) > 10
    theta = np.linspace(*window_of(geometry.stream).theta, 50)
    profile = perturbed_stream(geometry, impacts, theta)
    assert np.isfinite(profile.density.values).all()
    assert np.abs(profile.q_rho.values - 1).max() > 0.01


# --- the sky ----------------------------------------------------------------------------------


@pytest.mark.parametrize(("name", "arm"), ARMS)
def test_longitudes_of_the_streams_own_frame_serve_as_bins(shipped, name, arm):
    geometry = shipped(name, arm)
    own = geometry.frame.longitude
    theta = np.linspace(*window_of(geometry.stream).theta, 100)
    for coordinate in ("ell", own):
        there = sky.from_theta(geometry, theta, coordinate)
        assert sky.to_theta(geometry, there, coordinate) == pytest.approx(theta, abs=1e-9)
    edges = sky.longitude_bins(geometry, 0.5, coordinate=own)
    smooth = geometry.smooth_density(theta)
    for design in (default_design(geometry), published_design(geometry)):
        assert design.coordinate == own
        assert design.n_bin >= 7
    assert sky.observe(geometry, theta, smooth, edges, own) == pytest.approx(
        geometry.smooth_density(sky.to_theta(geometry, 0.5 * (edges[1:] + edges[:-1]), own)), abs=0.02
    )


@pytest.mark.parametrize(
    ("name", "arm", "low", "high", "n_bin"),
    [
        ("gd1", "leading", -60.0, -46.0, 7),
        ("gd1", "trailing", -34.0, -4.0, 15),
        ("pal5", "trailing", 0.25, 14.35, 141),
    ],
)
def test_published_bins_are_those_of_the_papers(shipped, name, arm, low, high, n_bin):
    design = published_design(shipped(name, arm))
    assert (design.edges[0], design.edges[-1], design.n_bin) == (low, pytest.approx(high), n_bin)
    assert design.order == 3


# --- refusals ---------------------------------------------------------------------------------


def changed(name, **values):
    model = named_stream(name).arm()
    return model.model_copy(update={"progenitor": model.progenitor.model_copy(update=values)})


@pytest.mark.parametrize(
    ("model", "words"),
    [
        (changed("pal5", v_los_kms=700.0), "progenitor: it is not bound"),
        (changed("gd1", pm_ell=60.0), "progenitor: it is not bound"),
        (
            named_stream("gd1-like").arm().model_copy(update={"progenitor": (1, 0.1, 0.02, 0.1, 0, 0)}),
            "plunges",
        ),
        (
            named_stream("gd1-like").arm().model_copy(update={"progenitor": (1.5, 10, 1, 0.1, 0.1, 0)}),
            "not bound",
        ),
        (
            named_stream("gd1-like")
            .arm()
            .model_copy(update={"progenitor": (12, 0.1, 1, 0.1, 0.1, 0), "age_gyr": 0.5}),
            "age_gyr: in 0.5 Gyr the progenitor does not even",
        ),
        (
            named_stream("gd1-like").arm().model_copy(update={"sigma_v_kms": 0.011, "age_gyr": 1.0}),
            "sigma_v_kms: with 0.011 km/s the stream is only",
        ),
    ],
)
def test_progenitors_that_leave_no_stream_are_refused_in_one_sentence(model, words):
    with pytest.raises(StreamError, match=words) as error:
        smooth_geometry(model)
    assert str(error.value).count(". ") == 0
    assert "\n" not in str(error.value)
