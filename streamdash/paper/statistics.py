"""How much of the information on the mass does each statistic keep?

The PDF of Qρ forgets where along the stream a value occurs, the power spectrum forgets phases, the
paper's principal components keep the profile. Each is given to one and the same classifier, trained on
the same streams and judged on the same streams it has never seen; and to one and the same evidence,
equation 5 of the paper over all components together (`streamdash.statistics.joint`), on those held-out
streams, with twenty numbers a stream from each statistic. The paper calls the evidence of power spectra
computationally prohibitive (appendix B); for that definition of it, it is not.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from streamdash.classifier.data import split
from streamdash.classifier.model import BEST, ClassifierConfig
from streamdash.classifier.train import Judged, Progress, ShouldStop, train
from streamdash.statistics.features import FeatureMap, FeatureSet
from streamdash.statistics.joint import JointEvidence, joint_evidence
from streamdash.statistics.pdf import measure_pdfs
from streamdash.statistics.scores import share_text
from streamdash.statistics.spectrum import power_spectrum
from streamdash.survey.design import Design
from streamdash.survey.observed import ObservedStreams

PDF, POWER, PROFILE = "PDF of Qρ", "power spectrum", "profile"
STATISTICS: dict[str, FeatureSet] = {
    PDF: FeatureSet(n_pca=0, summaries=("histogram",)),
    POWER: FeatureSet(n_pca=0, summaries=("power",)),
    f"{PDF} and {POWER}": FeatureSet(n_pca=0, summaries=("histogram", "power")),
    PROFILE: FeatureSet(n_pca=30, summaries=()),
    "all features of the best classifier": BEST.features,
}
"""What each classifier of the comparison is given."""
N_NUMBERS = 20
"""Numbers per stream that the evidence is given: bins of Qρ, largest scales, or principal components."""
MIN_STREAMS = 10
"""Bins of Qρ that fewer held-out streams of a class reach are left out of the evidence, as in the paper."""


@dataclass(frozen=True, eq=False)
class Kept:
    """What one statistic keeps.

    Attributes
    ----------
    name : key of `STATISTICS`.
    judged : its classifier, with its scores on the held-out streams.
    bits, bits_error : information on the class in bits per stream that the classifier's
        probabilities hold, ``log2(n_classes)`` minus their cross-entropy with the truth: a lower
        bound on what the statistic holds.
    evidence : by (i, j), ln B^{fid i}_ij from all its numbers together; empty where the evidence is not
        defined, as for a collection of features.
    """

    name: str
    judged: Judged
    bits: float
    bits_error: float
    evidence: Mapping[tuple[int, int], JointEvidence]


def compare_statistics(
    streams: ObservedStreams,
    noise: float,
    settings: ClassifierConfig = BEST,
    progress: Progress | None = None,
    should_stop: ShouldStop | None = None,
    workers: int = 1,
) -> list[Kept]:
    """Train and judge a classifier on each statistic, and measure its evidence, on one split.

    Parameters
    ----------
    streams : ObservedStreams
    noise : shot noise σ_ε per bin.
    settings : everything about the classifiers but their features.

    Raises
    ------
    Cancelled
        When `should_stop` said so.
    """
    evidence = statistics_evidence(streams, noise, settings.seed)
    rows = []
    for i, (name, features) in enumerate(STATISTICS.items()):
        judged = train(
            streams,
            noise,
            settings.model_copy(update={"features": features}),
            _part(progress, i),
            should_stop,
            workers,
        )
        rows.append(Kept(name, judged, *information(judged), evidence.get(name, {})))
    return rows


def information(judged: Judged) -> tuple[float, float]:
    """Bits per stream that a classifier's probabilities hold on the class, and the standard error.

    Classes count the same, as in training.
    """
    n_classes = judged.probability.shape[1]
    surprise = -np.log2(np.maximum(judged.probability[np.arange(len(judged.y)), judged.y], 1e-12))
    per_class = [surprise[judged.y == c] for c in range(n_classes)]
    mean = np.mean([part.mean() for part in per_class])
    error = math.sqrt(sum(part.var(ddof=1) / len(part) for part in per_class)) / n_classes
    return math.log2(n_classes) - float(mean), error


def statistics_evidence(
    streams: ObservedStreams, noise: float, seed: int = 0
) -> dict[str, dict[tuple[int, int], JointEvidence]]:
    """ln B^{fid i}_ij of every two classes from each statistic, on the held-out streams of a split.

    Parameters
    ----------
    seed : of the split, as in training.
    """
    sets = split(streams.y, seed)
    observed = streams.observed(noise)
    held = [observed[sets.test[streams.y[sets.test] == c]] for c in range(len(streams.labels))]
    components = FeatureMap.fit(observed[sets.train], FeatureSet(n_pca=N_NUMBERS, summaries=()))
    numbers: dict[str, list[np.ndarray]] = {
        PDF: list(measure_pdfs(held, N_NUMBERS).y),
        POWER: [_largest_scales(q, streams.design) for q in held],
        PROFILE: [components(q) for q in held],
    }
    return {name: _evidence(samples, sparse=name == PDF) for name, samples in numbers.items()}


def _largest_scales(q: np.ndarray, design: Design) -> np.ndarray:
    """Log power of the largest scales, `N_NUMBERS` in all, of each arm its share."""
    each = N_NUMBERS // len(design.stretches)
    spectra = [power_spectrum(q[:, arm], 1.0)[1][:, :each] for arm in design.stretches]
    return np.log(np.concatenate(spectra, axis=1))


def _evidence(samples: Sequence[np.ndarray], sparse: bool) -> dict[tuple[int, int], JointEvidence]:
    found: dict[tuple[int, int], JointEvidence] = {}
    for i, one in enumerate(samples):
        for j in range(i + 1, len(samples)):
            kept = np.ones(one.shape[1], dtype=bool)
            if sparse:
                kept = np.min([(y > 0).sum(axis=0) for y in (one, samples[j])], axis=0) >= MIN_STREAMS
            found[i, j], found[j, i] = joint_evidence(one, samples[j], kept)
    return found


def _part(progress: Progress | None, i: int) -> Callable[[int, int], None] | None:
    if progress is None:
        return None
    n = len(STATISTICS)
    return lambda done, total: progress(int(1000 * (i + done / total) / n), 1000)


# ---------------------------------------------------------------- numbers and text


def statistics_numbers(rows: Sequence[Kept], labels: Sequence[str], noise: float) -> dict[str, Any]:
    """The comparison as plain numbers, lists and text."""
    return {
        "labels": list(labels),
        "noise": noise,
        "n_test": len(rows[0].judged.y),
        "possible_bits": math.log2(len(labels)),
        "statistics": [
            {
                "name": row.name,
                "n_features": len(row.judged.classifier.features.names),
                "accuracy": float(row.judged.scores.values["overall_accuracy"]),
                "accuracy_error": float(row.judged.scores.errors["overall_accuracy"]),
                "bits": row.bits,
                "bits_error": row.bits_error,
                "evidence": [
                    {
                        "i": i,
                        "j": j,
                        "ln_b": found.value,
                        "word": found.word,
                        "n_unresolved": found.n_unresolved,
                    }
                    for (i, j), found in sorted(row.evidence.items())
                ],
            }
            for row in rows
        ],
    }


def statistics_markdown(numbers: Mapping[str, Any]) -> str:
    """The comparison as a Markdown table."""
    labels = numbers["labels"]
    pairs = [(e["i"], e["j"]) for e in numbers["statistics"][0]["evidence"]]
    heads = [f"ln B, truth {labels[i]} against {labels[j]}" for i, j in pairs]
    lines = [
        f"### What each statistic keeps: {len(labels)} classes, σ_ε = {numbers['noise']:g}, "
        f"{numbers['n_test']} held-out streams\n",
        f"Information in bits per stream, of {numbers['possible_bits']:.3f} possible.\n",
        f"| statistic | features | accuracy | information | {' | '.join(heads)} |",
        "|---" * (4 + len(heads)) + "|",
    ]
    for row in numbers["statistics"]:
        evidence = [ln_b_text(e["ln_b"], e["n_unresolved"]) for e in row["evidence"]] or ["–"] * len(pairs)
        accuracy = share_text(row["accuracy"], numbers["n_test"], digits=4)
        lines.append(
            f"| {row['name']} | {row['n_features']} | {accuracy} "
            f"| {row['bits']:.3f} ± {row['bits_error']:.3f} | {' | '.join(evidence)} |"
        )
    return "\n".join(lines) + "\n"


def ln_b_text(value: float, n_unresolved: int) -> str:
    """ln B as text, with a star where not all components are resolved by the streams there are."""
    return f"{value:z.1f}{'*' if n_unresolved else ''}"
