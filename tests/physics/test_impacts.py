"""What hits the stream: rates against galpy and the paper, samples against their formulas."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import integrate, stats

from streamdash.config import Perturbers
from streamdash.engine.galpy_streams import R0_KPC, V0_KMS
from streamdash.engine.impacts import (
    COLUMNS,
    Impacts,
    ImpactsError,
    check_impacts,
    expected_impacts,
    sample_impacts,
    stream_with_times,
    time_index,
)
from streamdash.engine.mass_function import mass_decades, scale_radius, subhalo_count

EXPECTED = {"1e3-1e5": 838.78, "1e5-1e9": 62.683, "1e5-1e7": 56.985, "1e7-1e9": 5.6985}


@pytest.mark.parametrize(("mass_range", "number"), EXPECTED.items())
def test_expected_numbers_of_the_default_stream(geometry, mass_range, number):
    found = expected_impacts(geometry, Perturbers(mass_range=mass_range))
    assert found == pytest.approx(number, rel=6e-5)


def test_rate_equals_galpys_encounters_summed_over_decades(smooth_of_today):
    """Both sides from galpy run here, so that only our formula can differ."""
    geometry, smooth = smooth_of_today
    perturbers = Perturbers(mass_range=(2e3, 7e6), X=3, sigma_h=90, profile="plummer", rs_factor=2.5)
    total = sum(
        smooth.subhalo_encounters(
            sigma=90 / V0_KMS,
            nsubhalo=subhalo_count(low, high, -2),
            bmax=3 * scale_radius(np.sqrt(low * high), perturbers) / R0_KPC,
        )
        for low, high in mass_decades(perturbers.mass_range)
    )
    assert expected_impacts(geometry, perturbers) == pytest.approx(total, rel=1e-10)


def test_without_the_width_floor_b_max_is_x_scale_radii(geometry):
    """The floor is galpy's: half the stream's width. Without it the count is in proportion to X."""
    assert 0.5 * geometry.width * geometry.mean_radius * R0_KPC == pytest.approx(0.0479, rel=0.01)
    light = [Perturbers(mass_range="1e3-1e5", X=x, width_floor=False) for x in (1.0, 5.0)]
    one, five = (expected_impacts(geometry, perturbers) for perturbers in light)
    assert five == pytest.approx(5 * one)
    assert five == pytest.approx(569.8, rel=1e-3)
    assert expected_impacts(geometry, Perturbers(mass_range="1e3-1e5", X=1.0)) > 4 * one
    heavy = Perturbers(mass_range="1e5-1e9")
    assert expected_impacts(geometry, heavy) == expected_impacts(
        geometry, heavy.model_copy(update={"width_floor": False})
    )


def test_rate_scales_with_its_factors(geometry):
    base = expected_impacts(geometry, Perturbers())
    assert expected_impacts(geometry, Perturbers(rate_factor=3)) == pytest.approx(3 * base)
    assert expected_impacts(geometry, Perturbers(length_factor=1.25)) == pytest.approx(1.25 * base)
    assert expected_impacts(geometry, Perturbers(rate_factor=0)) == 0
    assert expected_impacts(geometry, Perturbers(cutoff_mass=1e6)) < 0.5 * base


def test_any_slope_agrees_at_the_pivot():
    narrow = [subhalo_count(10**6.499, 10**6.501, slope) for slope in (-2.5, -2, -1.9, -1)]
    assert narrow == pytest.approx([narrow[1]] * 4, rel=1e-5)
    whole, _ = integrate.quad(lambda m: m**-1.9, 0.1, 7)
    unit, _ = integrate.quad(lambda m: m**-1.9, 1, 2)
    ratio = subhalo_count(10**5.5, 7 * 10**6.5, -1.9) / subhalo_count(10**6.5, 2 * 10**6.5, -1.9)
    assert ratio == pytest.approx(whole / unit)


@pytest.fixture(scope="module")
def many(geometry):
    """Some 200,000 impacts of one kind."""
    perturbers = Perturbers(mass_range="1e5-1e9", rate_factor=100)
    rng = np.random.default_rng(11)
    parts = [sample_impacts(geometry, perturbers, rng) for _ in range(32)]
    return perturbers, Impacts(*(np.concatenate([getattr(p, c) for p in parts]) for c in COLUMNS))


def test_number_is_poisson(geometry):
    perturbers, rng = Perturbers(mass_range="1e7-1e9"), np.random.default_rng(5)
    mean = expected_impacts(geometry, perturbers)
    numbers = np.array([len(sample_impacts(geometry, perturbers, rng)) for _ in range(4000)])
    seen = np.bincount(np.minimum(numbers, 12), minlength=13)
    odds = stats.poisson.pmf(np.arange(12), mean)
    odds = np.append(odds, 1 - odds.sum())
    assert stats.chisquare(seen, odds * len(numbers)).pvalue > 1e-3


def test_times_follow_the_physical_length(geometry, many):
    _, impacts = many
    lengths = []
    for k, end in enumerate(geometry.length_at(geometry.times)):
        fine = geometry._table(k, np.linspace(0, end, 4001))[:, :3]
        lengths.append(np.linalg.norm(np.diff(fine, axis=0), axis=1).sum())
    odds = np.array(lengths) / np.sum(lengths)
    seen = np.bincount(time_index(geometry, impacts), minlength=len(odds))
    assert stats.chisquare(seen, odds * seen.sum()).pvalue > 1e-3


def test_angles_are_uniform_in_physical_length(geometry, many):
    _, impacts = many
    index = time_index(geometry, impacts)
    k = np.bincount(index).argmax()
    end = geometry.length_at(geometry.times[k])
    grid = np.linspace(0, end, 4001)
    arc = np.concatenate(
        [[0], np.cumsum(np.linalg.norm(np.diff(geometry._table(k, grid)[:, :3], axis=0), axis=1))]
    )
    fraction = np.interp(impacts.theta[index == k], grid, arc / arc[-1])
    assert (impacts.theta <= geometry.length_at(geometry.times)[index] * (1 + 1e-9)).all()
    assert stats.kstest(fraction, "uniform").pvalue > 1e-3


def test_masses_sizes_and_impact_parameters(many):
    perturbers, impacts = many
    low, high = perturbers.mass_range

    def cumulative(mass):
        return (low**-0.5 - mass**-0.5) / (low**-0.5 - high**-0.5)

    assert stats.kstest(impacts.mass_msun, cumulative).pvalue > 1e-3
    assert impacts.r_s_kpc == pytest.approx(1.05 * np.sqrt(impacts.mass_msun / 1e8))
    assert stats.kstest(impacts.b_kpc / (5 * impacts.r_s_kpc), "uniform", (-1, 2)).pvalue > 1e-3


def test_cutoff_masses_follow_the_suppressed_function(geometry):
    perturbers = Perturbers(mass_range="1e5-1e9", cutoff_mass=1e7, rate_factor=100)
    rng = np.random.default_rng(3)
    mass = np.concatenate([sample_impacts(geometry, perturbers, rng).mass_msun for _ in range(10)])
    grid = np.geomspace(1e5, 1e9, 20001)
    density = grid**-1.5 * np.exp(-1e7 / grid)
    cumulative = integrate.cumulative_trapezoid(density, grid, initial=0)
    assert stats.kstest(mass, lambda m: np.interp(m, grid, cumulative / cumulative[-1])).pvalue > 1e-3


def test_velocities_in_the_streams_frame(geometry, many):
    _, impacts = many
    impacts = Impacts(*(getattr(impacts, c)[:20000] for c in COLUMNS))
    index = time_index(geometry, impacts)
    along = np.stack(
        [
            geometry._table(k, np.array([t]))[0, 3:6]
            for k, t in zip(index[:20000], impacts.theta, strict=False)
        ]
    )
    along /= np.linalg.norm(along, axis=1, keepdims=True)
    w = np.stack([impacts.vx_kms, impacts.vy_kms, impacts.vz_kms], axis=1)
    parallel = np.einsum("nc,nc->n", w, along)
    across = np.linalg.norm(w - parallel[:, None] * along, axis=1)
    assert stats.kstest(parallel / 120, "norm").pvalue > 1e-3
    # Rayleigh radially and Gaussian tangentially: together a chi distribution of 3.
    assert stats.kstest(across / 120, "chi", (3,)).pvalue > 1e-3


def test_csv_round_trip(geometry, tmp_path):
    impacts = sample_impacts(geometry, Perturbers(), np.random.default_rng(1))
    impacts.to_csv(tmp_path / "impacts.csv")
    again = Impacts.read_csv(tmp_path / "impacts.csv", geometry)
    assert all((getattr(impacts, c) == getattr(again, c)).all() for c in COLUMNS)


ROW = {
    "time_gyr": 9 / 65,
    "theta": 0.5,
    "b_kpc": 0.1,
    "vx_kms": 1,
    "vy_kms": 100,
    "vz_kms": 3,
    "mass_msun": 1e7,
    "r_s_kpc": 0.3,
}


@pytest.mark.parametrize(
    ("column", "value", "words"),
    [
        ("mass_msun", -1e5, "row 1, column mass_msun: must be positive"),
        ("r_s_kpc", 0, "row 1, column r_s_kpc: must be positive"),
        ("time_gyr", 9.5, "row 1, column time_gyr: must lie within the stream's life, 0 to 9 Gyr"),
        ("time_gyr", -1, "row 1, column time_gyr"),
        ("time_gyr", 0.2, "is not an impact time of this stream (nearest 0.138462 Gyr)"),
        ("theta", 3.0, "row 1, column theta: must lie on the stream as it was then"),
        ("theta", -0.1, "row 1, column theta"),
        ("b_kpc", "nan", "row 1, column b_kpc: must be a finite number"),
        ("vy_kms", "fast", "row 1, column vy_kms: must be a finite number (got fast)"),
        ("vz_kms", "inf", "row 1, column vz_kms"),
    ],
)
def test_bad_rows_are_named(geometry, tmp_path, column, value, words):
    path = tmp_path / "impacts.csv"
    row = {**ROW, column: value}
    path.write_text(",".join(row) + "\n" + ",".join(map(str, row.values())) + "\n")
    with pytest.raises(ImpactsError) as error:
        Impacts.read_csv(path, geometry)
    assert words in str(error.value)


def test_impacts_are_accepted_as_far_as_the_track_is_known(geometry, tmp_path):
    """Others' tables may hold some beyond the length, where less than a fifth of the density is left."""
    path, times = tmp_path / "impacts.csv", np.array(geometry.stream.impact_times_gyr)
    lengths, ends = geometry.length_at(geometry.times), geometry.table_ends
    assert (ends > 1.4 * lengths).all()
    assert (geometry.smooth_density(1.4 * lengths, geometry.times) > 1e-5).all()
    for theta in (1.0001 * lengths, 1.4 * lengths, ends):
        rows = {name: np.full(len(times), float(value)) for name, value in ROW.items()}
        Impacts(**{**rows, "time_gyr": times, "theta": theta}).to_csv(path)
        assert len(Impacts.read_csv(path, geometry)) == len(times)
    for k in (0, 31, 63):
        Impacts(**{**ROW, "time_gyr": times[k], "theta": ends[k] * 1.0001}).to_csv(path)
        with pytest.raises(
            ImpactsError, match=f"theta: must lie on the stream as it was then, 0 to {ends[k]:.4g}"
        ):
            Impacts.read_csv(path, geometry)


@pytest.mark.parametrize("text", ["", "time_gyr,theta\n1,2\n", "\x00\x01", "a;b\n"])
def test_files_that_are_no_table_of_impacts(tmp_path, text):
    path = tmp_path / "impacts.csv"
    path.write_text(text)
    with pytest.raises(ImpactsError):
        Impacts.read_csv(path)


@settings(max_examples=200, deadline=None)
@given(st.binary(max_size=400))
def test_hostile_files_end_in_one_sentence(tmp_path_factory, data):
    path = tmp_path_factory.mktemp("hostile") / "impacts.csv"
    path.write_bytes(data)
    with pytest.raises(ImpactsError):
        Impacts.read_csv(path)


def test_samples_are_always_acceptable(geometry):
    for seed in range(20):
        impacts = sample_impacts(
            geometry, Perturbers(mass_range="1e3-1e5", length_factor=1.4), np.random.default_rng(seed)
        )
        check_impacts(impacts, geometry)


def test_impacts_at_other_times_bring_their_own(geometry):
    stream = geometry.stream
    own = Impacts(stream.impact_times_gyr[7], 0.3, 0.1, 0.0, 100.0, 0.0, 1e7, 0.3)
    assert stream_with_times(stream, own) is stream
    other = Impacts(
        [1.0, 0.5, 1.0], [0.3] * 3, [0.1] * 3, [0.0] * 3, [99.0] * 3, [0.0] * 3, [1e7] * 3, [0.3] * 3
    )
    assert stream_with_times(stream, other).times_gyr == (0.5, 1.0)
    with pytest.raises(ImpactsError, match="row 2, column time_gyr: must lie within the stream's life"):
        stream_with_times(
            stream, Impacts([1, 9.5], [0.3] * 2, [0] * 2, [0] * 2, [9] * 2, [0] * 2, [1] * 2, [1] * 2)
        )
