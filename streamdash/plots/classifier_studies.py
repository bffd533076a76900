"""Figures of the classifier's studies: tuning, learning curve, noise, importance, comparison."""

from __future__ import annotations

from collections.abc import Sequence

import holoviews as hv
import numpy as np
import pandas as pd

from streamdash.classifier.studies import Contender, Curve, Grid, Importance
from streamdash.naming import ACCENT, class_colours
from streamdash.plots.classifier import class_names
from streamdash.plots.elements import GREY, error_bars, framed, level_lines, line, points, step_area
from streamdash.plots.live import TOOLS, Backend, use
from streamdash.plots.style import HAND, coordinate_label, coordinate_symbol

SIZE_LABEL = "Simulated streams per class"
WORTH = 0.01
"""A gain in accuracy below this is hardly a help."""
DEAD = 0.9
"""Accuracy below which a sentence says that the method no longer tells the classes apart well."""


# ---------------------------------------------------------------- learning and noise curves


def draw_curve(
    curve: Curve, labels: Sequence[str], xlabel: str, backend: Backend, logarithmic: bool = False
) -> hv.Overlay:
    """Accuracy (grey, thick) and recall per class (in class colours), with bootstrap errors."""
    use(backend)
    parts: list[hv.Element] = []
    for c, colour in enumerate(class_colours(labels)):
        parts += _with_errors(
            f"class {c}", curve.x, curve.recall[:, c], curve.recall_error[:, c], colour, backend
        )
    parts += _with_errors("accuracy", curve.x, curve.accuracy, curve.accuracy_error, GREY, backend)
    low, high = curve.x.min(), curve.x.max()
    ends = (low / 1.1, high * 1.1) if logarithmic else (low - 0.02 * high, 1.02 * high)
    bottom = min(curve.recall.min(), curve.accuracy.min()) - 0.03
    overlay = framed(parts, xlabel, "Share that is right", ends, (max(0.0, bottom), 1.01), backend)
    if backend == "bokeh":
        return overlay.opts(**TOOLS, logx=logarithmic, backend=backend)
    return overlay.opts(logx=logarithmic, backend=backend)


def curve_table(curve: Curve, xname: str, labels: Sequence[str]) -> pd.DataFrame:
    """One row per point: accuracy and recall of each class, with errors."""
    columns = {xname: curve.x, "accuracy": curve.accuracy, "accuracy_error": curve.accuracy_error}
    for c, label in enumerate(labels):
        columns[f"recall {label}"] = curve.recall[:, c]
        columns[f"recall_error {label}"] = curve.recall_error[:, c]
    return pd.DataFrame(columns)


def learning_sentence(curve: Curve) -> str:
    """Whether more simulations would help, in one sentence."""
    gain = curve.accuracy[-1] - curve.accuracy[-2]
    error = np.hypot(curve.accuracy_error[-1], curve.accuracy_error[-2])
    if gain > 2 * error:
        more = "more streams would still help"
    elif gain + 2 * error < WORTH:
        more = "more streams would hardly help"
    else:
        more = "too little to tell from these test streams whether more would help"
    return (
        f"Accuracy rises from {100 * curve.accuracy[0]:.1f} % with {curve.x[0]:.0f} streams per class to "
        f"{100 * curve.accuracy[-1]:.1f} ± {100 * curve.accuracy_error[-1]:.1f} % with {curve.x[-1]:.0f}; "
        f"the last doubling brought {100 * gain:+z.1f} ± {100 * error:.1f} %: {more}."
    )


def noise_sentence(curve: Curve) -> str:
    """Where the method dies, in one sentence."""
    chance = 1 / curve.recall.shape[1]
    head = f"Without noise {100 * curve.accuracy[0]:.1f} %" if curve.x[0] == 0 else "Trained at each noise"
    below = np.flatnonzero(curve.accuracy < DEAD)
    if len(below) == 0:
        middle = f"above {100 * DEAD:.0f} % up to σ_ε = {curve.x[-1]:g}"
    else:
        middle = f"below {100 * DEAD:.0f} % from σ_ε = {curve.x[below[0]]:g} on"
    return (
        f"{head} of the streams are put right; {middle}, and {100 * curve.accuracy[-1]:.1f} % at "
        f"σ_ε = {curve.x[-1]:g}, where guessing gives {100 * chance:.0f} %."
    )


def wrong_noise_sentence(curve: Curve, noise: float) -> str:
    """What a wrong error does to a classifier that was trained at `noise`, in one sentence."""
    at = int(np.argmin(np.abs(curve.x - noise)))
    parts = [
        f"{100 * curve.accuracy[i]:.1f} % where it is {curve.x[i]:g}"
        for i in range(len(curve.x))
        if i != at and 0.4 * noise <= curve.x[i] <= 3.1 * noise
    ]
    others = f", {', '.join(parts)}" if parts else ""
    return (
        f"Trained at σ_ε = {noise:g} and never told otherwise, the classifier puts "
        f"{100 * curve.accuracy[at]:.1f} % of the streams right where that is the true noise{others}. "
        "Its probabilities hold at the trained noise only."
    )


# ---------------------------------------------------------------- importance along l


def draw_importance(found: Importance, backend: Backend) -> hv.Overlay:
    """Rise of the log loss when a block of longitude is exchanged between streams."""
    use(backend)
    middle = 0.5 * (found.edges[:-1] + found.edges[1:])
    low, high = found.log_loss - found.log_loss_error, found.log_loss + found.log_loss_error
    parts = [
        step_area("blocks", found.edges, np.zeros(len(middle)), found.log_loss, ACCENT, backend),
        error_bars("error", middle, low, high, GREY, backend),
        level_lines("zero", [0.0], backend, dashed=False),
    ]
    top = max(1.1 * high.max(), 1e-3)
    bottom = min(0.0, 1.1 * low.min())
    ends = (found.edges.min(), found.edges.max())
    overlay = framed(
        parts, coordinate_label(found.coordinate), "Rise of the log loss", ends, (bottom, top), backend
    )
    return overlay.opts(**TOOLS, backend=backend) if backend == "bokeh" else overlay


def importance_table(found: Importance) -> pd.DataFrame:
    """One row per block: its ends in degrees, and what is lost without it."""
    return pd.DataFrame(
        {
            f"{found.coordinate}_low_deg": found.edges[:-1],
            f"{found.coordinate}_high_deg": found.edges[1:],
            "log_loss_rise": found.log_loss,
            "log_loss_error": found.log_loss_error,
            "accuracy_drop": found.accuracy,
            "accuracy_error": found.accuracy_error,
        }
    )


def importance_sentence(found: Importance) -> str:
    """Which block matters most, in one sentence."""
    best = int(found.log_loss.argmax())
    near = found.edges[best : best + 2]
    return (
        f"Most is lost without {coordinate_symbol(found.coordinate)} = {near[0]:.0f}° to {near[1]:.0f}°: "
        "the log loss rises by "
        f"{found.log_loss[best]:.3f} ± {found.log_loss_error[best]:.3f} and the accuracy falls by "
        f"{100 * found.accuracy[best]:.1f} ± {100 * found.accuracy_error[best]:.1f} %. "
        f"The progenitor is {found.progenitor}."
    )


# ---------------------------------------------------------------- tuning


def draw_grid(grid: Grid, backend: Backend) -> hv.Overlay:
    """Cross-validated accuracy against the number of trees, one line per depth."""
    use(backend)
    parts: list[hv.Element] = []
    for d, depth in enumerate(grid.depths):
        shade = 0.25 + 0.75 * d / max(1, len(grid.depths) - 1)
        colour = f"{ACCENT}{round(255 * shade):02x}"
        parts.append(line(f"depth {depth}", grid.n_trees, grid.accuracy[d], colour, backend))
        parts.append(points(f"points {depth}", grid.n_trees, grid.accuracy[d], colour, backend, size=5))
    chosen = grid.settings.boosting
    d = int(np.flatnonzero(grid.depths == chosen.max_depth)[0])
    s = int(np.flatnonzero(grid.n_trees == chosen.n_estimators)[0])
    best = (np.array([grid.n_trees[s]]), np.array([grid.accuracy[d, s]]))
    parts.append(points("chosen", *best, HAND, backend, size=12))
    ends = (0.0, float(grid.n_trees.max()) * 1.03)
    span = grid.accuracy.max() - grid.accuracy.min() + 0.01
    frame = (grid.accuracy.min() - 0.05 * span, grid.accuracy.max() + 0.05 * span)
    overlay = framed(parts, "Trees per class, n_estimators", "Accuracy, 5-fold CV", ends, frame, backend)
    return overlay.opts(**TOOLS, backend=backend) if backend == "bokeh" else overlay


def grid_table(grid: Grid) -> pd.DataFrame:
    """One row per grid point."""
    depth, size = np.meshgrid(grid.depths, grid.n_trees, indexing="ij")
    return pd.DataFrame(
        {
            "max_depth": depth.ravel(),
            "n_estimators": size.ravel(),
            "accuracy": grid.accuracy.ravel(),
            "error": grid.error.ravel(),
        }
    )


def grid_sentence(grid: Grid) -> str:
    """What was chosen, in one sentence."""
    chosen = grid.settings.boosting
    best = np.unravel_index(grid.accuracy.argmax(), grid.accuracy.shape)
    return (
        f"Stronger lines are deeper trees. Highest accuracy {100 * grid.accuracy[best]:.1f} ± "
        f"{100 * grid.error[best]:.1f} % at max_depth = {grid.depths[best[0]]}, n_estimators = "
        f"{grid.n_trees[best[1]]}; the simplest model within one error of it, large dot, has max_depth = "
        f"{chosen.max_depth} and n_estimators = {chosen.n_estimators}."
    )


# ---------------------------------------------------------------- comparison of presets


def draw_comparison(contenders: Sequence[Contender], labels: Sequence[str], backend: Backend) -> hv.Overlay:
    """Accuracy (grey) and recall per class (in class colours) of every contender, best at the top."""
    use(backend)
    ordered = _ordered(contenders)[::-1]
    place = np.arange(len(ordered))
    parts: list[hv.Element] = []
    for c, colour in enumerate(class_colours(labels)):
        recall = np.array([k.scores.values["recall"][c] for k in ordered])
        parts.append(points(f"class {c}", recall, place, colour, backend, size=8))
    accuracy = np.array([k.scores.values["overall_accuracy"] for k in ordered])
    parts.append(points("accuracy", accuracy, place, GREY, backend, size=13))
    least = min(k.scores.values["recall"].min() for k in ordered) - 0.02
    overlay = framed(
        parts, "Share that is right", "", (max(0.0, least), 1.005), (-0.5, len(ordered) - 0.5), backend
    )
    ticks = {"yticks": [(i, k.name) for i, k in enumerate(ordered)], "backend": backend}
    if backend == "bokeh":
        return overlay.opts(**TOOLS, **ticks)
    return overlay.opts(**ticks)


def comparison_table(contenders: Sequence[Contender], labels: Sequence[str]) -> pd.DataFrame:
    """One row per contender, best first."""
    rows = []
    for contender in _ordered(contenders):
        values = contender.scores.values
        row = {
            "name": contender.name,
            "accuracy": values["overall_accuracy"],
            "accuracy_low": float(contender.scores.interval("overall_accuracy")[0]),
            "accuracy_high": float(contender.scores.interval("overall_accuracy")[1]),
            "log_loss": values["log_loss"],
            "calibration_error": values["ece"],
            "seconds": contender.seconds,
        }
        row |= {f"recall {label}": values["recall"][c] for c, label in enumerate(labels)}
        rows.append(row)
    return pd.DataFrame(rows)


def comparison_sentence(contenders: Sequence[Contender], labels: Sequence[str]) -> str:
    """Who wins, in one sentence."""
    ordered = _ordered(contenders)
    first, last = ordered[0], ordered[-1]
    names = class_names(labels)
    recall = first.scores.values["recall"]
    parts = ", ".join(f"{100 * r:.1f} % of {n}" for n, r in zip(names, recall, strict=True))
    return (
        f"On the same test streams {first.name!r} is best with "
        f"{100 * first.scores.values['overall_accuracy']:.1f} % ({parts}); {last.name!r} is last with "
        f"{100 * last.scores.values['overall_accuracy']:.1f} %."
    )


def _ordered(contenders: Sequence[Contender]) -> list[Contender]:
    return sorted(contenders, key=lambda k: -float(k.scores.values["overall_accuracy"]))


def _with_errors(
    label: str, x: np.ndarray, y: np.ndarray, error: np.ndarray, colour: str, backend: Backend
) -> list[hv.Element]:
    return [
        line(label, x, y, colour, backend),
        error_bars(f"error of {label}", x, y - error, y + error, colour, backend),
        points(f"points of {label}", x, y, colour, backend, size=6),
    ]
