"""Words for the numbers of a report: shares, intervals, limits, and what would change the answer."""

from __future__ import annotations

from typing import Any

from streamdash.config import mass_label, parse_mass_range
from streamdash.naming import label_text, mass_text
from streamdash.observe.observation import Observation
from streamdash.observe.resemblance import DOUBTFUL, UNLIKE
from streamdash.observe.robustness import robustness_words
from streamdash.statistics.evidence import jeffreys
from streamdash.words import number_of, percent_between


def name(entry: dict[str, Any]) -> str:
    """A class as people call it."""
    return label_text(entry["mass_range"])


def percent(value: float) -> str:
    """A probability in words that do not claim more than was tested: ``93 %``, ``more than 99 %``."""
    if value > 0.99:
        return "more than 99 %"
    return "less than 1 %" if value < 0.01 else f"{100 * value:.0f} %"


def interval(entry: dict[str, Any]) -> str:
    """The 68 % interval of a class's probability, no finer than was tested."""
    low, high = entry["low"], entry["high"]
    if low > 0.99 or high < 0.01:
        return f"68 % interval {percent(low)}"
    ends = [">99" if end > 0.99 else "<1" if end < 0.01 else f"{100 * end:.0f}" for end in (low, high)]
    return f"68 % interval {ends[0]} to {ends[1]} %"


def right_share(quality: dict[str, Any]) -> str:
    """Share of held-out streams put right, with its 68 % interval."""
    return percent_between(quality["accuracy"], quality["accuracy_low"], quality["accuracy_high"])


def strange_share(likeness: dict[str, Any]) -> str:
    """How many true streams look as strange: ``at most about 1 in 330``."""
    rounded = float(f"{1 / likeness['p']:.2g}")
    return f"at most about 1 in {rounded:,.0f}"


def resemblance_words(result: dict[str, Any]) -> str:
    """The check against all classes, in words."""
    likeness = result["resemblance"]
    words = {
        "unlike": f"The profile is unlike every class (p < {UNLIKE:g}).",
        "unusual": f"The profile would be an unusual member of any class (p < {DOUBTFUL:g}).",
        "alike": "The profile looks like the simulated classes.",
    }[likeness["verdict"]]
    shares = [likeness[check] for check in ("p_distance", "p_pattern", "p_structure")]
    least = (
        f"The smallest of the three is no smaller than chance makes it (p = {likeness['p']:.2g})."
        if 3 * min(shares) >= 1
        else "The smallest of the three counts three times, as three were looked at: "
        f"p = {likeness['p']:.2g}."
    )
    return (
        f"{words} Of {likeness['n_held_out']} streams the method never saw, {_share(shares[0])} are as far "
        f"from the classes or farther, {_share(shares[1])} have as strange a pattern along the stream, and "
        f"{_share(shares[2])} have as little structure. {least}"
    )


def _share(p: float) -> str:
    return f"{100 * p:.{0 if p > 0.1 else 1}f} %"


def evidence_words(entry: dict[str, Any], result: dict[str, Any]) -> str:
    """PDF evidence against a class relative to the best one, within what the simulations can resolve."""
    value = entry["ln_bayes"]
    if value == 0:
        return "preferred"
    shown = f"ln B = {value:z.1f} ± {entry['ln_bayes_error']:.1f}"
    if entry.get("ln_bayes_is_limit", False):
        shown = f"ln B < −{-value:.1f}, all that the simulations can resolve"
    return f"{jeffreys(value)} against it ({shown.replace('= -', '= −')})"


def limits(observation: Observation) -> list[str]:
    """What part of the table the answer is not about; said beside it."""
    total, words = observation.n_rows, []
    if observation.n_outside:
        words.append(
            f"{observation.n_outside} of {total} bins lie outside the simulated stretch of the stream and "
            "were not used: the answer is not about them."
        )
    if observation.n_missing:
        words.append(f"{observation.n_missing} of {total} bins have no value and were treated as gaps.")
    return words


def tried(result: dict[str, Any], found: list[dict[str, Any]]) -> dict[str, Any]:
    """A report with its table of robustness, and what that says would change the answer."""
    result = {**result, "robustness": found}
    return {**result, "would_change": would_change(result)}


def would_change(result: dict[str, Any]) -> str:
    """What would change the answer: what was tried, or what was not."""
    if not result["resembles"]:
        return "What would change it: other mass ranges, rates or models of the stream, or other errors."
    found = result["robustness"]
    if not found:
        return (
            "What would change it was not tried: another polynomial, errors half or twice as large, half of "
            "the stream, other mass ranges."
        )
    better = next((row for row in found if row["name"] == "errors × 0.5" and not row["problem"]), None)
    words = [robustness_words(found)]
    if better is not None:
        words.append(
            f"With errors half as large the method would be right for {percent(better['accuracy'])} of "
            "simulated streams."
        )
    return " ".join(words)


def robustness_lines(result: dict[str, Any]) -> list[str]:
    """The table of robustness, one line for each row."""
    rows = result["robustness"]
    width = max(len(row["name"]) for row in rows)
    return [
        f"{row['name']:{width}}  "
        + (
            f"not possible: {row['problem']}"
            if row["problem"]
            else f"{row['best']:>9} {percent(row['probability']):>14}; {row['n_bins']} bins, right for "
            f"{percent(row['accuracy'])} of streams{'' if row['agrees'] else '  ← changes the answer'}"
        )
        for row in rows
    ]


def truth_words(known: dict[str, Any]) -> str:
    """What a mock observation really is."""
    mass = mass_text(parse_mass_range(mass_label(parse_mass_range(str(known["mass_range"])))))
    return (
        f"The truth: a simulated stream hit by {number_of(int(known['n_impacts']), 'perturber')} of {mass}."
    )
