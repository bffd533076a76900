"""The paper's extension: cold dark matter over 10³–10⁹ M☉ against the same with an excess of clusters.

The paper compares mass ranges at their own abundances and calls the full range, with each model's own
abundance, an important extension. Here both classes have all subhalos of cold dark matter
(`streamdash.populations.cold`), and one of them `excess` times as many more of 10³–10⁵ M☉. How large
must the excess be to be seen at a given shot noise? Classifier, evidence and power spectrum answer on
the same held-out streams.
"""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from streamdash.classifier.model import BEST, ClassifierConfig
from streamdash.classifier.train import train
from streamdash.config import EnsembleConfig
from streamdash.engine.impacts import expected_impacts
from streamdash.paper.statistics import PDF, POWER, STATISTICS, information, ln_b_text, statistics_evidence
from streamdash.paths import DOCS
from streamdash.populations import cold, with_excess
from streamdash.simulation.geometry import load_geometry
from streamdash.statistics.scores import share_interval, share_text
from streamdash.store.cache import Cache, StoreError
from streamdash.survey.observed import ObservedStreams

NOISES = (0.1, 0.05, 0.02)
"""Shot noise σ_ε per 0.2° bin."""
SEEN = 0.5
"""An excess counts as seen where a stream tells half a bit of the one there is to tell."""


def _excess(config: EnsembleConfig) -> float:
    return config.population.components[0].rate_factor - 1.0


def ensembles(cache: Cache) -> dict[float, EnsembleConfig]:
    """The largest complete ensemble of the default stream by its excess; 0 is cold dark matter alone.

    Raises
    ------
    StoreError
        When there are not both the one without an excess and one with; names the command that makes one.
    """

    def alike(config: EnsembleConfig) -> bool:
        same = config.prior is None and config.stream == EnsembleConfig().stream
        return same and config.population == with_excess(_excess(config))

    found: dict[float, EnsembleConfig] = {}
    for entry in cache.complete_ensembles(alike):
        config, excess = entry.config, _excess(entry.config)
        if excess not in found or config.n_streams > found[excess].n_streams:
            found[excess] = config
    for excess, name in ((0.0, "cdm"), (1.0, "clusters-1")):
        if excess not in found and (not excess or len(found) < 2):
            raise StoreError(f"The full range needs `streamdash simulate --preset {name}` first.")
    return dict(sorted(found.items()))


def full_range_results(
    cache: Cache, noises: Sequence[float] = NOISES, settings: ClassifierConfig = BEST, workers: int = 1
) -> dict[str, Any]:
    """How well an excess of clusters is seen, by its size and the noise.

    Returns
    -------
    dict
        ``impacts`` expected without an excess, ``seen`` by noise (`needed`), and ``rows``: one for
        each excess and noise, with accuracy and information in bits of the best classifier and of one
        given only the power spectrum, and ln B of PDF and power spectrum with cold dark matter and
        with the excess as truth; numbers, lists and text only.
    """
    configs = ensembles(cache)
    plain = configs.pop(0.0)
    rows = []
    for excess, config in configs.items():
        streams = ObservedStreams.read(cache, [plain, config])
        rows += [{"excess": excess, **_row(streams, noise, settings, workers)} for noise in noises]
    geometry = load_geometry(plain.stream, cache)
    return {
        "impacts": [expected_impacts(geometry, part) for part in cold().components],
        "n_streams": plain.n_streams,
        "rows": rows,
        "needed": [{"noise": noise, "excess": needed(rows, noise)} for noise in noises],
    }


def shipped_results() -> dict[str, Any] | None:
    """The study's results as they are shipped, of `full_range_results`; None where they are not."""
    path = DOCS / "reproduction/full_range.json"
    return json.loads(path.read_text(encoding="utf-8")) if path.is_file() else None


def _row(streams: ObservedStreams, noise: float, settings: ClassifierConfig, workers: int) -> dict[str, Any]:
    row: dict[str, Any] = {"noise": noise}
    given = {"best": settings.features, "spectrum": STATISTICS[POWER]}
    for name, features in given.items():
        judged = train(streams, noise, settings.model_copy(update={"features": features}), workers=workers)
        bits, bits_error = information(judged)
        row[name] = {
            "accuracy": float(judged.scores.values["overall_accuracy"]),
            "accuracy_error": float(judged.scores.errors["overall_accuracy"]),
            "bits": bits,
            "bits_error": bits_error,
        }
        row["n_test"] = len(judged.y)
    evidence = statistics_evidence(streams, noise, settings.seed)
    for name, statistic in (("evidence", PDF), ("spectrum_evidence", POWER)):
        both = (evidence[statistic][ij] for ij in ((0, 1), (1, 0)))
        row[name] = [{"ln_b": found.value, "n_unresolved": found.n_unresolved} for found in both]
    return row


def needed(rows: Sequence[Mapping[str, Any]], noise: float, seen: float = SEEN) -> float | None:
    """Smallest excess at which a stream tells `seen` bits, between those measured; None when none does.

    Interpolated in the logarithm of the excess; the smallest excess measured when already that is seen.
    """
    found = sorted((row["excess"], row["best"]["bits"]) for row in rows if row["noise"] == noise)
    above = [i for i, (_, bits) in enumerate(found) if bits >= seen]
    if not above:
        return None
    i = above[0]
    if i == 0:
        return float(found[0][0])
    (x0, y0), (x1, y1) = found[i - 1], found[i]
    return math.exp(float(np.interp(seen, [y0, y1], [math.log(x0), math.log(x1)])))


def sentence(results: Mapping[str, Any]) -> str:
    """The answer in one sentence."""
    smallest = min(row["excess"] for row in results["rows"])
    largest = max(row["excess"] for row in results["rows"])

    def words(excess: float | None) -> str:
        if excess is None:
            return f"more than {largest:g}"
        return f"{smallest:g} or less" if excess <= smallest else f"about {excess:.2g}"

    parts = [f"{words(one['excess'])} at σ_ε = {one['noise']:g}" for one in results["needed"]]
    return (
        f"One stream tells half a bit on whether there are more clusters of 10³–10⁵ M☉ than cold dark matter "
        f"has where the excess, in units of cold dark matter's number, is {', '.join(parts)}."
    )


def _bits_text(bits: float, error: float, accuracy: float, n_test: int) -> str:
    """Information with an error that can hold, ``0.030 ± 0.014`` or ``0.000 (at most 0.006)``.

    A classifier that gives every stream the same probability tells nothing and scatters by nothing. Its
    limit is then what it tells that is right as often as the upper end of its accuracy's interval.
    """
    if error >= 0.0005:
        return f"{bits:.3f} ± {error:.3f}"
    right = float(share_interval(accuracy * n_test, n_test)[1])
    most = 1 + sum(p * math.log2(p) for p in (right, 1 - right) if p > 0)
    return f"{bits:.3f} (at most {max(most, bits):.3f})"


def full_range_markdown(results: Mapping[str, Any]) -> str:
    """The study as a Markdown table and its sentence."""
    low, high = results["impacts"]
    lines = [
        f"### Full range: cold dark matter 10³–10⁹ M☉ against the same with an excess of clusters, "
        f"{results['n_streams']} streams a class\n",
        f"Expected impacts without an excess: {low:.1f} of 10³–10⁵ M☉ and {high:.1f} of 10⁵–10⁹ M☉; "
        "an excess of 1 doubles the former. Accuracy and information (bits, of 1) on held-out streams; "
        "ln B with cold dark matter, and with the excess, as the truth.\n",
        "| excess | σ_ε | accuracy | information | spectrum alone: accuracy | information "
        "| ln B, PDF | ln B, spectrum |",
        "|---" * 8 + "|",
    ]
    for row in results["rows"]:
        cells = [f"{row['excess']:g}", f"{row['noise']:g}"]
        for name in ("best", "spectrum"):
            one = row[name]
            cells.append(share_text(one["accuracy"], row["n_test"]))
            cells.append(_bits_text(one["bits"], one["bits_error"], one["accuracy"], row["n_test"]))
        for name in ("evidence", "spectrum_evidence"):
            cells.append(", ".join(ln_b_text(b["ln_b"], b["n_unresolved"]) for b in row[name]))
        lines.append(f"| {' | '.join(cells)} |")
    return "\n".join([*lines, "", sentence(results)]) + "\n"
