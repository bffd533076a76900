"""Confusion matrix, ROC, calibration and the streams behind a cell (paper fig. 6, table 2)."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import holoviews as hv
import numpy as np
import pandas as pd

from streamdash.classifier.train import Judged
from streamdash.naming import ACCENT, class_colour, class_colours, label_text
from streamdash.plots.elements import GREY, error_bars, framed, line, points
from streamdash.plots.live import TOOLS, Backend, Columns, use
from streamdash.plots.style import INK, coordinate_label
from streamdash.statistics.scores import calibration, roc
from streamdash.survey.observed import ObservedStreams

SELECTED = "selected"
_CORNERS = ("left", "bottom", "right", "top")
METRICS = {"precision": "Precision", "recall": "Recall", "f1": "F₁", "accuracy": "Accuracy", "auc": "AUC"}
SHOWN_STREAMS = 4
UNEQUAL = 1.5
"""Classes whose numbers of streams differ by this factor are said to be unequal."""
"""Streams of a cell that are drawn, the least certain first."""


def class_names(labels: Sequence[str]) -> list[str]:
    """Classes as people read them: ``10³–10⁵ M☉``."""
    return [label_text(label) for label in labels]


# ---------------------------------------------------------------- confusion matrix


def draw_matrix(
    judged: Judged, backend: Backend, selected: tuple[int, int] | None = None, dark: bool = False
) -> hv.Overlay:
    """Counts and percentages; rows are the true classes from top to bottom.

    Cell (truth i, taken for j) is the square around x = j, y = −i.
    """
    use(backend)
    n_classes = len(judged.scores.counts)
    shares = judged.scores.percent / 100
    cells, texts = [], []
    for i in range(n_classes):
        for j in range(n_classes):
            colour = f"{class_colour(i, judged.classifier.card.labels)}{round(20 + 225 * shares[i, j]):02x}"
            cells.append((j - 0.48, -i - 0.46, j + 0.48, -i + 0.46, colour))
            ink = "#ffffff" if shares[i, j] > 0.45 else INK["dark" if dark else "light"]
            words = f"{judged.scores.counts[i, j]}\n{100 * shares[i, j]:.1f} %"
            texts.append((j, -i, words, ink))
    squares = hv.Rectangles(cells, vdims="colour", label="cells")
    words = hv.Labels(texts, ["x", "y"], ["text", "ink"], label="words")
    parts: list[hv.Element] = [_styled(squares, words, backend)]
    if selected is not None:
        columns = selected_columns(*selected)[SELECTED]
        frame = hv.Rectangles([tuple(column[0] for column in columns.values())], label=SELECTED)
        parts.append(_framed_cell(frame, backend, dark))
    names = class_names(judged.classifier.card.labels)
    overlay = framed(
        parts,
        "Taken for",
        "True class",
        (-0.5, n_classes - 0.5),
        (-n_classes + 0.5, 0.5),
        backend,
    )
    ticks = {
        "xticks": list(enumerate(names)),
        "yticks": [(-i, name) for i, name in enumerate(names)],
        "backend": backend,
    }
    if backend == "bokeh":
        return overlay.opts(**ticks, tools=[], default_tools=[], toolbar=None, height=90 + 90 * n_classes)
    return overlay.opts(**ticks, aspect=1.3)


def selected_columns(truth: int, taken_for: int) -> Columns:
    """New data of the matrix in the browser when another cell is looked into."""
    ends = (taken_for - 0.48, -truth - 0.46, taken_for + 0.48, -truth + 0.46)
    return {SELECTED: {name: np.array([end]) for name, end in zip(_CORNERS, ends, strict=True)}}


def _styled(squares: hv.Rectangles, words: hv.Labels, backend: Backend) -> hv.Overlay:
    if backend == "matplotlib":
        squares = squares.opts(facecolor=hv.dim("colour"), edgecolor="none", backend=backend)
        words = words.opts(color=hv.dim("ink"), size=11, backend=backend)
    else:
        squares = squares.opts(color=hv.dim("colour"), line_alpha=0, backend=backend)
        words = words.opts(text_color=hv.dim("ink"), text_font_size="12pt", backend=backend)
    return squares * words


def _framed_cell(frame: hv.Rectangles, backend: Backend, dark: bool) -> hv.Rectangles:
    ink = INK["dark" if dark else "light"]
    if backend == "matplotlib":
        return frame.opts(facecolor="none", edgecolor=ink, linewidth=2, backend=backend)
    return frame.opts(fill_alpha=0, line_color=ink, line_width=3, backend=backend)


def matrix_table(judged: Judged) -> pd.DataFrame:
    """The confusion matrix as rows: true class, class taken for, count and percent."""
    labels = judged.classifier.card.labels
    return pd.DataFrame(
        [
            {"true_class": a, "taken_for": b, "count": judged.scores.counts[i, j], "percent": percent}
            for i, a in enumerate(labels)
            for j, b in enumerate(labels)
            for percent in [judged.scores.percent[i, j]]
        ]
    )


def matrix_sentence(judged: Judged) -> str:
    """What the matrix shows, in one or two sentences."""
    scores, names = judged.scores, class_names(judged.classifier.card.labels)
    text = (
        f"Of {len(judged.y)} streams that were never trained on, {scores.percent_text('overall_accuracy')} "
        f"are put in the right class (σ_ε = {_noise_text(judged)})."
    )
    text += unequal_words(names, judged.classifier.card.n_streams)
    wrong = scores.counts - np.diag(np.diag(scores.counts))
    if not wrong.any():
        return f"{text} None is wrong."
    i, j = np.unravel_index(wrong.argmax(), wrong.shape)
    return f"{text} The most common mistake: {wrong[i, j]} of {names[i]} taken for {names[j]}."


def unequal_words(names: Sequence[str], n_streams: Sequence[int]) -> str:
    """What classes of unequal numbers of streams mean for the probabilities; empty where they are alike."""
    if max(n_streams) < UNEQUAL * min(n_streams):
        return ""
    numbers = ", ".join(f"{n} of {name}" for n, name in zip(n_streams, names, strict=True))
    return (
        f" There are {numbers}: classes weigh the same in training, so that each is as probable as any other "
        "beforehand, but this share counts streams as they come, and the smallest class is known least."
    )


# ---------------------------------------------------------------- ROC and calibration


def draw_roc(judged: Judged, backend: Backend) -> hv.Overlay:
    """True against false positives of each class against the rest."""
    use(backend)
    fpr, tpr = roc(judged.y, judged.probability)
    parts: list[hv.Element] = [line("chance", np.array([0, 1]), np.array([0, 1]), GREY, backend, dashed=True)]
    colours = class_colours(judged.classifier.card.labels)
    parts += [line(f"class {c}", fpr, rate, colours[c], backend) for c, rate in enumerate(tpr)]
    overlay = framed(parts, "False positives, share", "True positives, share", (-0.01, 1), (0, 1.02), backend)
    return overlay.opts(**TOOLS, backend=backend) if backend == "bokeh" else overlay


def roc_table(judged: Judged) -> pd.DataFrame:
    """ROC curves: one column of true-positive rates per class."""
    fpr, tpr = roc(judged.y, judged.probability)
    columns = {
        f"true_positive_rate {name}": rate
        for name, rate in zip(judged.classifier.card.labels, tpr, strict=True)
    }
    return pd.DataFrame({"false_positive_rate": fpr, **columns})


def roc_sentence(judged: Judged) -> str:
    """Areas under the curves, in one sentence."""
    names = class_names(judged.classifier.card.labels)
    areas = (f"{n}: {judged.scores.text('auc', c, digits=4)}" for c, n in enumerate(names))
    return f"Area under the curve (1 is perfect, 0.5 is guessing): {'; '.join(areas)}."


def draw_calibration(judged: Judged, backend: Backend) -> hv.Overlay:
    """How often the chosen class is right, against the probability it was given."""
    use(backend)
    curve = calibration(judged.y, judged.probability)
    low = np.clip(curve.accuracy - curve.error, 0, 1)
    high = np.clip(curve.accuracy + curve.error, 0, 1)
    parts = [
        line("honest", np.array([0, 1]), np.array([0, 1]), GREY, backend, dashed=True),
        error_bars("error", curve.confidence, low, high, ACCENT, backend),
        *_single(judged, backend),
        points("bins", curve.confidence, curve.accuracy, ACCENT, backend),
    ]
    least = 1 / len(judged.scores.counts) - 0.03
    overlay = framed(
        parts,
        "Probability given to the chosen class",
        "Share that is right",
        (least, 1.02),
        (0, 1.05),
        backend,
    )
    return overlay.opts(**TOOLS, backend=backend) if backend == "bokeh" else overlay


def _single(judged: Judged, backend: Backend) -> list[hv.Element]:
    """The uncertain streams one by one where they are few: right ones above, wrong ones below."""
    if not nearly_perfect(judged):
        return []
    sure = judged.probability.max(axis=1)
    right = (judged.probability.argmax(axis=1) == judged.y).astype(float)
    uncertain = sure < SURE
    return [points("single", sure[uncertain], right[uncertain], GREY, backend, size=5)]


def calibration_table(judged: Judged) -> pd.DataFrame:
    """Reliability per bin of the chosen class's probability."""
    curve = calibration(judged.y, judged.probability)
    return pd.DataFrame(
        {
            "mean_probability": curve.confidence,
            "share_right": curve.accuracy,
            "error": curve.error,
            "streams": curve.count,
        }
    )


def calibration_sentence(judged: Judged) -> str:
    """The expected calibration error, in one sentence."""
    scores = judged.scores
    single = ""
    if nearly_perfect(judged):
        uncertain = int((judged.probability.max(axis=1) < SURE).sum())
        single = f" {uncertain} of {len(judged.y)} streams got less than 99 %: grey, each by itself."
    return (
        f"Expected calibration error {scores.values['ece']:.3f} ± {scores.errors['ece']:.3f}, "
        f"log loss {scores.values['log_loss']:.3f} ± {scores.errors['log_loss']:.3f}: "
        "points on the dashed line mean that a probability of 80 % is right 80 % of the time."
        f"{single}"
    )


# ---------------------------------------------------------------- what is left to see of a near-perfect one

FEW = 10
"""Fewer wrong test streams than these, and a ROC curve is a corner."""
SURE = 0.99
"""Below it a stream is called uncertain."""
LEAST_DOUBT = 1e-4


def nearly_perfect(judged: Judged) -> bool:
    """Whether so few test streams are wrong that their ROC curve shows nothing."""
    return int((judged.probability.argmax(axis=1) != judged.y).sum()) < FEW


def doubts(judged: Judged) -> np.ndarray:
    """Probability that each test stream's true class was not given (n_test,)."""
    return 1.0 - judged.probability[np.arange(len(judged.y)), judged.y]


def draw_doubt(judged: Judged, backend: Backend) -> hv.Overlay:
    """How many test streams of each class are doubted by at least so much; both axes are logarithmic."""
    use(backend)
    doubt, n_classes = doubts(judged), judged.probability.shape[1]
    x = np.geomspace(LEAST_DOUBT, 1, 200)
    guessing = 1 - 1 / n_classes
    most = float(np.bincount(judged.y).max())
    parts: list[hv.Element] = [
        line("guessing", np.array([guessing] * 2), np.array([0.5, 2 * most]), GREY, backend, dashed=True)
    ]
    for c in range(n_classes):
        count = (doubt[judged.y == c][:, None] >= x).sum(axis=0).astype(float)
        parts.append(
            line(
                f"class {c}",
                x,
                np.where(count > 0, count, np.nan),
                class_colour(c, judged.classifier.card.labels),
                backend,
            )
        )
    overlay = framed(
        parts,
        "Doubt: probability of the wrong classes",
        "Test streams doubted by so much or more",
        (LEAST_DOUBT, 1),
        (0.5, 2 * most),
        backend,
        log=True,
    )
    return overlay.opts(**TOOLS, backend=backend) if backend == "bokeh" else overlay


def doubt_table(judged: Judged) -> pd.DataFrame:
    """The test streams that are doubted most, one row each."""
    doubt = doubts(judged)
    order = np.argsort(-doubt)[:100]
    labels = judged.classifier.card.labels
    predicted = judged.probability.argmax(axis=1)
    return pd.DataFrame(
        {
            "row": judged.rows[order],
            "true_class": [labels[c] for c in judged.y[order]],
            "taken_for": [labels[c] for c in predicted[order]],
            "doubt": doubt[order],
        }
    )


def doubt_sentence(judged: Judged) -> str:
    """What is left to see, in words."""
    doubt = doubts(judged)
    wrong = int((judged.probability.argmax(axis=1) != judged.y).sum())
    some, more = (int((doubt >= least).sum()) for least in (0.01, 0.1))
    return (
        f"{wrong} of {len(doubt)} test streams are wrong: a ROC curve would be a corner. Instead, how many "
        f"are doubted: {some} by 1 % or more, {more} by 10 % or more."
    )


# ---------------------------------------------------------------- streams of one cell


def draw_streams(
    streams: ObservedStreams, judged: Judged, rows: np.ndarray, backend: Backend, dark: bool = False
) -> list[hv.Overlay]:
    """The least certain streams of a cell: as observed (thin) and without noise (thick), one plot each."""
    use(backend)
    observed = streams.observed(np.asarray(judged.classifier.card.noise))
    owner, index = streams.locate(rows[:SHOWN_STREAMS])
    starts = [stretch.start for stretch in streams.design.stretches[1:]]

    def between(values: np.ndarray) -> np.ndarray:
        return np.insert(values, starts, np.nan)  # lifts the pen from arm to arm

    where = between(streams.centers)
    shown, colours = [], class_colours(streams.configs)
    for row, c, i in zip(rows, owner, index, strict=False):
        clean = line("stream", where, between(streams.clean[row]), colours[c], backend)
        noisy = line("observed", where, between(observed[row]), GREY, backend)
        if backend == "bokeh":
            noisy = noisy.opts(line_width=0.8, backend=backend)
        else:
            noisy = noisy.opts(linewidth=0.6, backend=backend)
        overlay = framed(
            [noisy, clean],
            coordinate_label(streams.design.coordinate),
            "Qρ",
            (streams.centers.min(), streams.centers.max()),
            (0, 3),
            backend,
            f"stream {i}" if backend == "matplotlib" else "",
        )
        if backend == "bokeh":
            overlay = overlay.opts(**TOOLS | {"toolbar": None}, height=190, backend=backend)
        shown.append(overlay)
    return shown


def streams_layout(streams: ObservedStreams, judged: Judged, rows: np.ndarray) -> hv.Layout:
    """The least certain streams of a cell on one page, for a file."""
    use("matplotlib")
    shown = draw_streams(streams, judged, rows, "matplotlib")
    if not shown:
        raise ValueError("No test stream is in this cell.")
    return hv.Layout(shown).cols(2)


def streams_table(streams: ObservedStreams, judged: Judged, rows: np.ndarray) -> pd.DataFrame:
    """All streams of a cell: which they are, and the probability of each class."""
    owner, index = streams.locate(rows)
    probability = judged.probability[np.searchsorted(judged.rows, rows)]
    labels = judged.classifier.card.labels
    columns = {"true_class": [labels[c] for c in owner], "stream": index}
    if streams.n_impacts:
        columns["n_impacts"] = [streams.n_impacts[c][i] for c, i in zip(owner, index, strict=True)]
    columns["std_q_rho"] = streams.clean[rows].std(axis=1)
    columns |= {f"probability {label}": probability[:, c] for c, label in enumerate(labels)}
    return pd.DataFrame(columns)


def stream_caption(record: dict[str, Any]) -> str:
    """One row of `streams_table` in words."""
    impacts = f", {record['n_impacts']} impacts" if "n_impacts" in record else ""
    shares = ", ".join(
        f"{class_names([name.removeprefix('probability ')])[0]}: {100 * value:.0f} %"
        for name, value in record.items()
        if name.startswith("probability ")
    )
    return f"Stream {record['stream']}{impacts} · {shares}"


def streams_sentence(streams: ObservedStreams, judged: Judged, truth: int, taken_for: int) -> str:
    """What sets the streams of a cell apart from those of their class that are put right."""
    names = class_names(judged.classifier.card.labels)
    rows, right = judged.cell(truth, taken_for), judged.cell(truth, truth)
    verb = "put right" if truth == taken_for else f"taken for {names[taken_for]}"
    head = f"{len(rows)} of {judged.scores.counts[truth].sum()} test streams of {names[truth]} are {verb}"
    if truth == taken_for or len(rows) == 0 or len(right) == 0:
        shown = min(SHOWN_STREAMS, len(rows))
        return f"{head}; the {shown} least certain are shown." if shown else f"{head}."
    ours, others = (float(np.median(streams.clean[r].std(axis=1))) for r in (rows, right))
    text = f"{head}. Their Qρ spreads by {ours:.2f} (median of its standard deviation), against {others:.2f}"
    if streams.n_impacts:
        hits, usual = (_median_impacts(streams, r) for r in (rows, right))
        text += f", and they had {hits:g} impacts, against {usual:g},"
    return f"{text} among those put right."


def _median_impacts(streams: ObservedStreams, rows: np.ndarray) -> float:
    owner, index = streams.locate(rows)
    return float(np.median([streams.n_impacts[c][i] for c, i in zip(owner, index, strict=True)]))


def _noise_text(judged: Judged) -> str:
    noise = judged.classifier.card.noise
    return f"{noise:g}" if isinstance(noise, float) else "as observed"
