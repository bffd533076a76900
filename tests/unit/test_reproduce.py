"""`streamdash reproduce`: files, numbers and text hold together; a small cache, then the shipped one."""

from __future__ import annotations

import csv
import io
import json
import re
from pathlib import Path

import numpy as np
import pytest

from streamdash.cli.main import app
from streamdash.cli.reproduce import rounded
from streamdash.paper import choices as reproduce_choices
from streamdash.paper.choices import CHOICES, measure_choices
from streamdash.paper.differences import NOTES, differences
from streamdash.paper.evidence import THREE_CLASSES, TWO_CLASSES, find_entries, load_sample, measure
from streamdash.paper.tables import table_csv, table_markdown, table_rows
from streamdash.statistics.evidence import PAPER_N_BINS, PAPER_RULES, PAPER_TABLE_1, measured_evidence
from streamdash.store.cache import Cache, StoreError

ROOT = Path(__file__).resolve().parents[2]
RESULTS = ROOT / "docs" / "reproduction" / "results.json"


@pytest.fixture(scope="module")
def cache(shipped_cache) -> Cache:
    return Cache((shipped_cache,))


@pytest.fixture(scope="module")
def sample(cache):
    return load_sample(cache)


@pytest.fixture(scope="module")
def results(sample, geometry):
    return measure(sample, geometry)


def run(capsys, *arguments: str) -> tuple[int, str, str]:
    """Exit code, standard output and standard error of the command."""
    with pytest.raises(SystemExit) as end:
        app(["reproduce", *arguments], prog_name="streamdash")
    captured = capsys.readouterr()
    return int(end.value.code or 0), captured.out, captured.err


def test_numbers_are_those_of_the_library(sample, results):
    noisy = sample.only(TWO_CLASSES).noisy(0.1)
    for table in results["two_classes"]["tables"]:
        evidence = measured_evidence(noisy, 0.1, table["n_bin"], PAPER_RULES)[1]
        for pair in table["pairs"]:
            total = evidence.cumulative(pair["i"], pair["i"], pair["j"])
            assert pair["sum"] == total.value
            assert pair["n_kept"] == total.n_kept
            assert pair["paper"] == PAPER_TABLE_1[pair["i"], pair["j"]][PAPER_N_BINS.index(table["n_bin"])]


def test_paper_stands_only_beside_its_own_classes(results):
    assert all("paper" not in pair for table in results["three_classes"]["tables"] for pair in table["pairs"])
    assert results["three_classes"]["labels"] == list(THREE_CLASSES)


def test_expected_impacts_are_the_papers(results):
    """Section 2: about 839 and 62 impacts."""
    found = {fact["label"]: fact["expected_impacts"] for fact in results["ensembles"]}
    assert found["1e3-1e5"] == pytest.approx(839, abs=0.5)
    assert found["1e5-1e9"] == pytest.approx(62.683, rel=0.01)


def test_small_masses_give_strong_evidence_and_more_than_large_ones(results):
    """The paper's main conclusions (section 4.1), whatever the exact numbers."""
    for table in results["two_classes"]["tables"]:
        small, large = table["pairs"]
        assert small["word"] == "strong"
        assert small["sum"] > large["sum"]


def test_csv_and_markdown_hold_the_same_table(results):
    rows = list(csv.DictReader(io.StringIO(table_csv(results))))
    assert len(rows) == len(table_rows(results)) == 4 * (2 + 6)
    markdown = table_markdown(results)
    printed = np.array([float(number) for number in re.findall(r"-?\d+\.\d", markdown)])
    for row in rows:
        assert np.abs(printed - float(row["sum"])).min() <= 0.06  # both are rounded
    assert "| the paper’s | 9.0 | 18.0 | 33.1 | 53.5 |" in markdown
    assert "| the paper’s | 4.0 | 5.4 | 3.1 | 1.3 |" in markdown


@pytest.mark.slow
def test_command_writes_everything(small_cache_of_four, tmp_path, capsys, geometry):
    results = measure(load_sample(Cache((small_cache_of_four,))), geometry)
    options = ("--cache", str(small_cache_of_four), "--no-classifier", "-o", str(tmp_path / "deep" / "er"))
    code, out, err = run(capsys, *options)
    assert (code, err) == (0, "")
    assert out == table_markdown(results)
    folder = tmp_path / "deep" / "er"
    assert sorted(path.name for path in folder.iterdir()) == ["results.json", "table1.csv", "table1.md"]
    assert json.loads((folder / "results.json").read_text(encoding="utf-8")) == rounded(results)


@pytest.mark.slow
def test_command_draws_the_figures_of_the_paper_and_its_appendices(shipped_cache, tmp_path, capsys):
    code, _, _ = run(capsys, "--cache", str(shipped_cache), "--no-classifier", "--figures", str(tmp_path))
    assert code == 0
    appendices = ["appendixB", *(f"appendixA{number}" for number in range(1, 6))]
    for name in [*(f"figure{number}" for number in range(1, 6)), *appendices]:
        assert (tmp_path / f"{name}.png").read_bytes().startswith(b"\x89PNG")
        svg = (tmp_path / f"{name}.svg").read_text(encoding="utf-8")
        assert svg.rstrip().endswith("</svg>")
        assert len(svg) > 20_000
    assert (tmp_path / "results.json").is_file()


def test_an_empty_cache_says_what_to_run(tmp_path, capsys):
    code, _, err = run(capsys, "--cache", str(tmp_path / "none"), "-o", str(tmp_path / "out"))
    assert code == 2
    assert "streamdash simulate --mass 1e3-1e5" in err
    assert err.count("\n") == 1


def test_a_folder_that_cannot_be_made_is_one_sentence(shipped_cache, tmp_path, capsys):
    (tmp_path / "file").write_text("")
    code, _, err = run(capsys, "--cache", str(shipped_cache), "-o", str(tmp_path / "file" / "out"))
    assert code == 2
    assert "cannot be made" in err


def test_the_largest_ensemble_of_a_range_is_used(cache):
    entries = find_entries(cache, TWO_CLASSES)
    assert [entry.config.population.label for entry in entries] == list(TWO_CLASSES)
    with pytest.raises(StoreError, match="1e2-1e4"):
        find_entries(cache, ["1e2-1e4"])


def test_choices_change_one_thing_each(cache, sample, results, monkeypatch):
    wanted = {"2.5 σ_ε", "only 10", "0 to 2", "the first 1000 of each", "1e7-1e9 M☉ in place of 1e5-1e9 M☉"}
    rows = measure_choices(cache, sample, [choice for choice in CHOICES if choice.text in wanted])
    assert {row["text"] for row in rows[1:]} == wanted
    plain = rows[0]
    two = results["two_classes"]["tables"]
    assert plain["fid_0"] == [table["pairs"][0]["sum"] for table in two]
    assert plain["fid_1"] == [table["pairs"][1]["sum"] for table in two]
    assert plain["kept"] == [table["pairs"][0]["n_kept"] for table in two]
    for row in rows[1:]:
        assert row["fid_0"] != plain["fid_0"], row["text"]
    three = [
        next(p for p in t["pairs"] if (p["i"], p["j"]) == (0, 2)) for t in results["three_classes"]["tables"]
    ]
    (other,) = [row for row in rows if row["topic"] == reproduce_choices.MODEL]
    # Not exactly equal: there the common range of Qρ is that of three models.
    np.testing.assert_allclose(other["fid_0"], [pair["sum"] for pair in three], rtol=0.05)


def test_several_realisations_are_averaged(cache, sample):
    (choice,) = [choice for choice in CHOICES if choice.text == "four sets of 500 of each"]
    row = measure_choices(cache, sample, [choice])[1]
    assert all(scatter > 0 for scatter in row["scatter_0"])


def test_every_topic_is_explained():
    assert {choice.topic for choice in CHOICES} == set(NOTES)


def test_committed_text_is_rendered_from_the_committed_results():
    text = (ROOT / "docs" / "differences.md").read_text(encoding="utf-8")
    assert text == differences(json.loads(RESULTS.read_text(encoding="utf-8")))


def test_committed_results_are_those_of_the_shipped_cache(results):
    committed = json.loads(RESULTS.read_text(encoding="utf-8"))
    assert [e["key"] for e in committed["ensembles"]] == [e["key"] for e in results["ensembles"]]
    for part in ("two_classes", "three_classes"):
        for old, new in zip(committed[part]["tables"], results[part]["tables"], strict=True):
            for a, b in zip(old["pairs"], new["pairs"], strict=True):
                assert a["sum"] == pytest.approx(b["sum"], rel=1e-3, abs=0.02)
                assert a["joint"] == pytest.approx(b["joint"], rel=0.05, abs=0.2)


def test_text_says_the_opposite_when_numbers_turn_out_otherwise():
    """Statements are chosen by the numbers: a made-up result in which everything agrees."""
    results = json.loads(RESULTS.read_text(encoding="utf-8"))
    rows = results["choices"]
    for row in rows[1:2]:
        row["fid_0"], row["fid_1"] = list(PAPER_TABLE_1[0, 1]), list(PAPER_TABLE_1[1, 0])
    for table in results["two_classes"]["tables"]:
        for pair in table["pairs"]:
            pair["joint"] = pair["sum"] / 2
    text = differences(results)
    assert "No single choice brings" not in text
    assert "closer to the paper than any choice" not in text
    assert "below the plain sum in every case" in text
