"""The named streams, and progenitors on the sky."""

from __future__ import annotations

import json

import numpy as np
import pytest

import streamdash
from streamdash.config import (
    ConfigError,
    EnsembleConfig,
    EquatorialProgenitor,
    GalacticProgenitor,
    LogarithmicHalo,
    MWPotential2014,
    StreamModel,
)
from streamdash.engine.galpy_streams import progenitor_orbit
from streamdash.streams import (
    STREAM_NAMES,
    Stream,
    angles_of,
    bins_of,
    named_stream,
    stream_of,
    stream_text,
    window_of,
)

ARMS = [(name, arm) for name in STREAM_NAMES for arm in named_stream(name).arms]
PAL5 = named_stream("pal5").arms["trailing"].progenitor


# --- what there is ----------------------------------------------------------------------------


def test_scripts_find_streams_by_name():
    stream = streamdash.named_stream("pal5")
    assert isinstance(stream, Stream)
    assert isinstance(stream.arms["trailing"], StreamModel)
    assert set(stream.arms) == {"leading", "trailing"} == set(named_stream("gd1").arms)
    assert set(named_stream("gd1-like").arms) == {"leading"}


def test_the_default_stream_is_the_papers():
    assert named_stream("gd1-like").arm() == StreamModel()
    assert EnsembleConfig().stream == StreamModel()


@pytest.mark.parametrize(("name", "arm"), ARMS)
def test_every_arm_is_described(name, arm):
    stream = named_stream(name)
    model = stream.arms[arm]
    assert model.arm == arm
    assert model.age_gyr in stream.ages_gyr
    assert set(stream.windows) == set(stream.bins) == set(stream.arms)
    assert all(caveat.endswith(".") for caveat in stream.caveats)
    assert bins_of(model).coordinate in ("ell", stream.frame.longitude)
    np.testing.assert_allclose(
        np.array(stream.frame.rotation) @ np.array(stream.frame.rotation).T, np.eye(3), atol=1e-9
    )


@pytest.mark.parametrize(("name", "arm"), ARMS)
def test_an_ensemble_has_the_angles_of_its_stream(name, arm):
    model = named_stream(name).arms[arm]
    config = EnsembleConfig(stream=model)
    assert (config.theta_min, config.theta_max, config.n_theta) == tuple(angles_of(model).values())
    assert EnsembleConfig.parse({"stream": json.loads(model.model_dump_json())}) == config
    assert EnsembleConfig(stream=model, theta_max=0.5).theta_max == 0.5
    assert EnsembleConfig.parse(config.model_dump_json()) == config


def test_a_model_is_known_by_its_progenitor_at_any_age():
    older = named_stream("gd1").at_age(7.0).arms["trailing"]
    assert stream_of(older).name == "gd1"
    assert older.sigma_v_kms == pytest.approx(0.3 * 3.2 / 7.0)
    assert named_stream("pal5").at_age(10.0).arm("leading").sigma_v_kms == pytest.approx(0.25)
    assert named_stream("gd1-like").at_age(4.5).arm().dispersion_kms == pytest.approx(0.365)
    assert "age_gyr 7" in stream_text(older)
    with pytest.raises(ConfigError, match="age_gyr"):
        named_stream("gd1").at_age(0.0)


def test_names_for_people_differ():
    texts = [stream_text(named_stream(name).arms[arm]) for name, arm in ARMS]
    assert len(set(texts)) == len(texts)
    assert texts[0] == "GD-1-like"


# --- refusals ---------------------------------------------------------------------------------


@pytest.mark.parametrize("name", ["", "GD-1", "pal5 ", "x" * 1000, None, 5])
def test_an_unknown_stream_is_refused_in_one_sentence(name):
    with pytest.raises(ConfigError) as error:
        named_stream(name)
    assert "gd1-like, gd1, pal5" in str(error.value)
    assert len(str(error.value)) < 120


@pytest.mark.parametrize("arm", ["trailing", "middle", "x" * 1000])
def test_an_arm_that_is_not_there_is_refused_in_one_sentence(arm):
    with pytest.raises(ConfigError, match="gd1-like has a leading arm") as error:
        named_stream("gd1-like").arm(arm)
    assert len(str(error.value)) < 120


SEEN = {"distance_kpc": 20.0, "v_los_kms": 5.0}


@pytest.mark.parametrize(
    ("value", "words"),
    [
        ({"progenitor": {"ra": 1.0}}, "stream.progenitor.distance_kpc: field required"),
        (
            {"progenitor": {**SEEN, "ra": 1, "dec": 99, "pm_ra": 0, "pm_dec": 0}},
            "stream.progenitor.dec: input",
        ),
        ({"progenitor": {**SEEN, "ell": 1, "b": 9, "pm_ell": 0}}, "stream.progenitor.pm_b: field required"),
        ({"progenitor": {**SEEN, "ra": 1, "b": 9}}, "stream.progenitor.dec: field required"),
        ({"progenitor": {}}, "stream.progenitor.distance_kpc: field required"),
        ({"progenitor": "somewhere"}, "stream.progenitor: input"),
        ({"progenitor": [1.0, 2.0]}, "stream.progenitor.2: field required"),
        ({"progenitor": [1.0, 0.1, 1.0, 0.1, 0.1, float("nan")]}, "stream.progenitor.5"),
        (
            {"progenitor": {**json.loads(PAL5.model_dump_json()), "solar_motion_kms": [0, 500, 0]}},
            "stream.progenitor.solar_motion_kms: no component",
        ),
        ({"potential": {"name": "MilkyWay"}}, "stream.potential.name: input should be 'MWPotential2014'"),
        ({"potential": {"name": "MWPotential2014", "q": 0.9}}, "stream.potential.q: extra inputs"),
        ({"potential": 3}, "stream.potential: input"),
    ],
)
def test_bad_streams_are_refused_in_one_sentence_that_names_the_field(value, words):
    with pytest.raises(ConfigError) as error:
        EnsembleConfig.parse({"stream": value})
    assert str(error.value).startswith(words)
    assert "\n" not in str(error.value)
    assert "as:" not in str(error.value)


# --- identity ---------------------------------------------------------------------------------


def test_shipped_entries_keep_their_keys(shipped_cache):
    """A key is in each folder's name; the configuration beside it must still hash to it."""
    checked = 0
    for path in sorted(shipped_cache.glob("*/*-*/config.json")):
        config = json.loads(path.read_text())
        key = path.parent.name.rpartition("-")[2]
        parent = path.parent.parent.name
        if parent == "geometries":
            assert StreamModel.parse(config).key == key
        elif parent == "ensembles":
            assert EnsembleConfig.parse(config).key == key
        checked += parent != "spectra"
    assert checked >= 16


def test_potentials_are_told_apart():
    assert StreamModel.parse({"potential": {"q": 0.8}}).potential == LogarithmicHalo(q=0.8)
    assert StreamModel.parse({"potential": {}}).potential == LogarithmicHalo()
    assert StreamModel.parse({"potential": {"name": "MWPotential2014"}}).potential == MWPotential2014()
    assert StreamModel(potential=MWPotential2014()).key != StreamModel().key
    assert "name" not in LogarithmicHalo().model_dump()


# --- the sky ----------------------------------------------------------------------------------


def test_a_progenitor_is_the_same_in_both_systems_of_the_sky():
    from galpy.util import coords

    ell, b = coords.radec_to_lb(PAL5.ra, PAL5.dec, degree=True, epoch=None)
    pm_ell, pm_b = coords.pmrapmdec_to_pmllpmbb(
        PAL5.pm_ra, PAL5.pm_dec, PAL5.ra, PAL5.dec, degree=True, epoch=None
    )
    galactic = GalacticProgenitor(
        ell=float(ell), b=float(b), pm_ell=float(pm_ell), pm_b=float(pm_b), distance_kpc=23.2, v_los_kms=-58.7
    )
    one, other = (progenitor_orbit(StreamModel(progenitor=seen)).vxvv[0] for seen in (PAL5, galactic))
    assert one == pytest.approx(other, rel=1e-9)


def test_a_progenitor_on_the_sky_is_where_it_was_put():
    """Converted to natural units and seen again from the same Sun."""
    moved = PAL5.model_copy(update={"r0_kpc": 8.2, "v0_kms": 235.0, "z_sun_kpc": 0.02})
    for seen in (PAL5, moved):
        orbit = progenitor_orbit(StreamModel(progenitor=seen))
        u, v, w = seen.solar_motion_kms
        sun = [seen.r0_kpc, 0.0, seen.z_sun_kpc, u, v + seen.v0_kms, w]
        physical = {"obs": sun, "ro": 8.0, "vo": 220.0, "use_physical": True}
        assert orbit.ra(**physical) == pytest.approx(seen.ra, abs=1e-6)
        assert orbit.dec(**physical) == pytest.approx(seen.dec, abs=1e-6)
        assert orbit.dist(**physical) == pytest.approx(seen.distance_kpc, rel=1e-9)
        assert orbit.pmra(**physical) == pytest.approx(seen.pm_ra, rel=1e-6)
        assert orbit.pmdec(**physical) == pytest.approx(seen.pm_dec, rel=1e-6)
        assert orbit.vlos(**physical) == pytest.approx(seen.v_los_kms, rel=1e-6)


def test_a_stream_of_ones_own_lies_in_a_frame_around_its_progenitor():
    own = StreamModel(progenitor=PAL5.model_copy(update={"distance_kpc": 22.0}))
    stream = stream_of(own)
    assert (stream.name, stream.frame.longitude) == ("own", "xi")
    assert stream.frame.rotation == named_stream("pal5").frame.rotation
    assert window_of(own).theta_max < 1.0
    assert isinstance(own.progenitor, EquatorialProgenitor)


def test_a_variant_of_the_default_stream_keeps_its_frame():
    variant = StreamModel(progenitor=(1.5, 0.35, -1.15, 0.88, -0.47, 0.12), age_gyr=5.0)
    assert stream_of(variant).frame == named_stream("gd1-like").frame
    assert EnsembleConfig(stream=variant).theta_max == 0.987
