"""What is told about an observation: the same numbers and sentences for page, command, file.

`report` puts everything into one plain dictionary, which is the JSON; text and HTML are made from it.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from streamdash.classifier.abundance import WORDS
from streamdash.config import parse_mass_range
from streamdash.naming import label_text
from streamdash.observe import misfit
from streamdash.observe.caveats import caveats
from streamdash.observe.detection import DETECTED, smooth_p
from streamdash.observe.observation import Observation
from streamdash.observe.provenance import provenance, provenance_words
from streamdash.observe.verdict import Prepared, Verdict
from streamdash.observe.wording import (
    evidence_words,
    interval,
    limits,
    name,
    percent,
    resemblance_words,
    right_share,
    robustness_lines,
    strange_share,
    would_change,
)

DECIDED = 0.75
"""Below this probability of the best class the profile is said not to decide."""
STRONG = 5.0
"""|ln B| of strong evidence on Jeffreys' scale; for another class than the classifier's it undecides, if it
is still strong once the classifier's own odds are taken off."""
LEAST = 1e-6
"""Probabilities are told apart down to this."""
DECIDED_FOR, UNDECIDED, UNLIKE_ANY, NOTHING = VERDICTS = (
    "decided",
    "undecided",
    "unlike anything simulated",
    "nothing detected",
)
"""What a report may begin with."""


def report(verdict: Verdict, observation: Observation, prepared: Prepared) -> dict[str, Any]:
    """Everything about one observation: numbers, lists and text only.

    Returns
    -------
    dict
        ``verdict`` (one of `VERDICTS`), ``answer``, ``agreement`` and ``would_change`` (text), ``limits``
        (sentences), ``robustness`` (rows of `streamdash.observe.robustness`, see
        `streamdash.observe.wording.tried`), ``detected``
        (bool: whether a perturbation is seen at all; where not, none of the classes is claimed),
        ``resembles`` (bool), ``warnings`` (sentences, none where nothing is doubtful), ``smooth_p``,
        ``hangs_on`` (what assumption about the data a sure answer hangs on, empty where none is suspected),
        ``abundance`` (probabilities if it is free, None where they are not known), ``resemblance``,
        ``classes`` (each with ``mass_range``, ``probability``, ``low`` and ``high``), ``quality``,
        ``assumptions``, ``caveats``, ``provenance`` and ``profile``.
    """
    scores, likeness, evidence = verdict.judged.scores, verdict.resemblance, verdict.evidence
    accuracy, accuracy_error = verdict.accuracy
    accuracy_low, accuracy_high = (float(end) for end in scores.interval("overall_accuracy"))
    most = float(np.log(min(len(q) for q in prepared.streams.q)))  # all that the simulations can resolve
    classes = []
    for c, label in enumerate(verdict.labels):
        classes.append(
            {
                "mass_range": label,
                "probability": float(verdict.probability[c]),
                "low": float(verdict.low[c]),
                "high": float(verdict.high[c]),
                "interval_models": [float(verdict.models_low[c]), float(verdict.models_high[c])],
                "ln_bayes": max(float(evidence.ln_bayes[c]), -most),
                "ln_bayes_error": float(evidence.error[c]),
                "ln_bayes_is_limit": bool(evidence.ln_bayes[c] < -most),
            }
        )
    design = observation.design
    p = smooth_p(observation)
    result: dict[str, Any] = {
        "verdict": "",
        "answer": "",
        "detected": p < DETECTED,
        "resembles": not likeness.unlike,
        "warnings": [],
        "limits": limits(observation),
        "would_change": "",
        "robustness": [],
        "smooth_p": p,
        "abundance": _abundance(verdict, prepared),
        "hangs_on": {"kind": verdict.misled.kind, "p": verdict.misled.p},
        "agreement": "",
        "resemblance": {
            "verdict": "unlike" if likeness.unlike else "unusual" if likeness.doubtful else "alike",
            "p": likeness.p,
            "p_distance": likeness.p_distance,
            "p_pattern": likeness.p_pattern,
            "p_structure": likeness.p_structure,
            "n_held_out": likeness.n_streams,
        },
        "classes": classes,
        "quality": {
            "accuracy": accuracy,
            "accuracy_error": accuracy_error,
            "accuracy_low": accuracy_low,
            "accuracy_high": accuracy_high,
            "confusion": scores.counts.tolist(),
            "precision": scores.values["precision"].tolist(),
            "calibration_error": float(scores.values["ece"]),
            "pdf_accuracy": evidence.accuracy,
            "n_held_out": int(scores.counts.sum()),
            "n_streams": [len(q) for q in prepared.streams.q],
            "refused": list(prepared.refused),
            "accuracy_if_errors_are_wrong": [list(pair) for pair in prepared.wrong_errors],
        },
        "assumptions": list(observation.stated),
        "columns": observation.assumptions.model_dump(),
        "caveats": caveats(observation, prepared),
        "ensembles": list(prepared.streams.keys),
        "provenance": provenance(prepared.streams.configs, prepared.streams.n_impacts),
        "profile": {
            "coordinate": design.coordinate,
            "low_deg": design.low.tolist(),
            "high_deg": design.high.tolist(),
            "value": observation.q.tolist(),
            "error": design.sigma.tolist(),
        },
    }
    result["verdict"] = verdict_of(result)
    result["answer"], result["agreement"] = answer(result), agreement(result)
    result["warnings"] = warnings(result)
    result["would_change"] = would_change(result)
    return result


def verdict_of(result: dict[str, Any]) -> str:
    """Which of `VERDICTS` it is.

    Undecided is a probability of the best class below `DECIDED`, at the simulated abundance or with it free,
    an interval that crosses one half, PDF evidence for another class that is strong even after the
    classifier's odds, or an answer that hangs on an assumption about the data
    (`streamdash.observe.misfit`).
    """
    if not result["resembles"]:
        return UNLIKE_ANY
    if not result["detected"]:
        return NOTHING
    if result["hangs_on"]["kind"]:
        return UNDECIDED
    best = _best(result)
    crosses = best["low"] < 0.5 < best["high"]
    return UNDECIDED if _honest(result) < DECIDED or crosses or _clash(result) else DECIDED_FOR


def warnings(result: dict[str, Any]) -> list[str]:
    """What makes the answer doubtful, one sentence each; none where nothing does.

    That nothing is detected is an answer, ``detected`` and the first words of ``answer``, and no doubt about
    data or models: it is not repeated here, and what there would be to doubt about a class is not either, as
    none is claimed.
    """
    best = _best(result)
    rival = max(result["classes"], key=lambda c: c["ln_bayes"])
    found = []
    if not result["resembles"]:
        found.append("The profile resembles none of the compared classes; do not use the probabilities.")
    elif result["hangs_on"]["kind"]:
        found.append(misfit.WORDS[result["hangs_on"]["kind"]])
    claimed = result["resembles"] and result["detected"]
    if claimed and best["low"] < 0.5 < best["high"]:
        found.append("Observed again, the same stream might be put to another class.")
    if claimed and _clash(result):
        found.append(f"The distribution of Qρ alone is strong evidence for {name(rival)} instead.")
    if claimed and _overturned(result):
        found.append(f"The abundance decides. {abundance_words(result)}")
    return [*found, *_nested(result)]


def _abundance(verdict: Verdict, prepared: Prepared) -> dict[str, Any] | None:
    """What changes if the abundance of each class is not the simulated one."""
    if verdict.free is None or prepared.free is None:
        return None
    return {
        "words": WORDS,
        "probability": [float(p) for p in verdict.free],
        "accuracy": prepared.free.accuracy[0],
        "fixed_accuracy": prepared.free.fixed_accuracy,
    }


def abundance_words(result: dict[str, Any]) -> str:
    """The best class's probability if the abundance is free; what is left open where it is not known."""
    free, best = result["abundance"], _best(result)
    if free is None:
        return (
            "The probabilities hold at the abundance that was simulated; the cache has no streams of these "
            "classes with other abundances."
        )
    return (
        f"With an abundance {free['words']}, {name(best)} has a probability of {percent(_free(result))}, "
        f"at the simulated one {percent(best['probability'])}. Of streams of any such abundance "
        f"{percent(free['accuracy'])} are put right, and {percent(free['fixed_accuracy'])} if the simulated "
        "one is taken for granted."
    )


def _free(result: dict[str, Any]) -> float:
    """Probability of the best class with the abundance free; where that is unknown, at the simulated one."""
    best = _best(result)
    free = result.get("abundance")
    return free["probability"][result["classes"].index(best)] if free else best["probability"]


def _honest(result: dict[str, Any]) -> float:
    """Probability of the best class by the less sure of the two."""
    return min(_best(result)["probability"], _free(result))


def _overturned(result: dict[str, Any]) -> bool:
    """Whether another class would be decided for if the abundance were free."""
    free, mine = result.get("abundance"), result["classes"].index(_best(result))
    return free is not None and any(p > DECIDED for c, p in enumerate(free["probability"]) if c != mine)


def _clash(result: dict[str, Any]) -> bool:
    """Whether PDF evidence for another class is strong even after the classifier's odds against it."""
    best = _best(result)
    rival = max(result["classes"], key=lambda c: c["ln_bayes"])
    odds = np.log(best["probability"] / max(rival["probability"], LEAST))
    return bool(rival["ln_bayes"] - best["ln_bayes"] - max(odds, 0.0) > STRONG)


def _nested(result: dict[str, Any]) -> list[str]:
    """Classes of which one's masses are among the other's do not exclude one another."""
    ranges = [(c["mass_range"], _masses(c["mass_range"])) for c in result["classes"]]
    return [
        f"{label_text(wide)} holds {label_text(narrow)}: the two do not exclude one another, and their "
        "probabilities only rank populations of these very rates."
        for wide, a in ranges
        for narrow, b in ranges
        if a and b and a != b and a[0] <= b[0] and b[1] <= a[1]
    ]


def _masses(label: str) -> tuple[float, float] | None:
    """Masses of a class that is called by its range; None of others."""
    try:
        return parse_mass_range(label)
    except ValueError:
        return None


def _best(result: dict[str, Any]) -> dict[str, Any]:
    return max(result["classes"], key=lambda c: c["probability"])


def answer(result: dict[str, Any]) -> str:
    """What may be quoted: the verdict, what decides or forbids it, and a sentence with its condition."""
    if result["verdict"] == NOTHING:
        return (
            "Nothing detected. No perturbation is seen at this noise: the data are as a smooth stream would "
            f"be (p = {result['smooth_p']:.2g}). If one of these classes hit the stream all the same: "
            f"{_sentence(result)}"
        )
    hangs_on = misfit.WORDS.get(result["hangs_on"]["kind"], "") if result["resembles"] else ""
    nested = _nested(result) if result["resembles"] else []
    return " ".join(
        part for part in (f"{result['verdict'].capitalize()}.", hangs_on, *nested, _sentence(result)) if part
    )


def _sentence(result: dict[str, Any]) -> str:
    likeness, quality = result["resemblance"], result["quality"]
    if likeness["verdict"] == "unlike":
        return (
            "This profile resembles none of the compared classes: of simulated streams observed like it, "
            f"{strange_share(likeness)} look as strange (p = {likeness['p']:.2g}), so the probabilities of "
            "the classes should not be used."
        )
    best = _best(result)
    right = (
        f"with bins and errors like these the method is right for {percent(quality['accuracy'])} of "
        "simulated streams"
    )
    others = " or ".join(name(c) for c in result["classes"] if c is not best)
    unusual = "Though an unusual profile for any class " if likeness["verdict"] == "unusual" else ""
    p = f"(p = {likeness['p']:.2g}), it" if unusual else "This profile"
    if best["probability"] < DECIDED:
        return (
            f"{unusual}{p} does not decide between the classes: perturbers of {name(best)} have a "
            f"probability of {percent(best['probability'])}, if it is one of these; {right}."
        )
    free = result.get("abundance")
    if free and _free(result) < DECIDED:
        return (
            f"{unusual}{p} looks more like a stream perturbed by {name(best)} than by {others} only if the "
            f"abundance is the simulated one: probability {percent(best['probability'])} then, and "
            f"{percent(_free(result))} with an abundance {free['words']}; {right}."
        )
    sure = f"{percent(best['probability'])} ({interval(best)})"
    if free:
        sure = f"{percent(_free(result))} with an abundance {free['words']}, {sure} at the simulated one"
    return (
        f"{unusual}{p} looks more like a stream perturbed by {name(best)} than by {others}: probability "
        f"{sure}, if it is one of these; {right}."
    )


def agreement(result: dict[str, Any]) -> str:
    """Whether classifier and PDF evidence prefer the same class; empty where neither counts."""
    if result["resemblance"]["verdict"] == "unlike":
        return ""
    best = _best(result)
    rival = max(result["classes"], key=lambda c: c["ln_bayes"])
    quality = result["quality"]
    if best is rival:
        return f"The distribution of Qρ alone (PDF evidence) also prefers {name(best)}."
    return (
        f"The two methods disagree: the distribution of Qρ alone (PDF evidence) prefers {name(rival)}. It is "
        f"right for {percent(quality['pdf_accuracy'])} of simulated streams of this quality, the classifier "
        f"for {percent(quality['accuracy'])}."
    )


def text(result: dict[str, Any]) -> str:
    """The report as plain text for a terminal."""
    width = max(len(c["mass_range"]) for c in result["classes"])
    set_aside = result["resemblance"]["verdict"] == "unlike"
    lines = [result["answer"], *result["limits"], result["agreement"], result["would_change"], ""]
    lines += [resemblance_words(result), ""]
    if result["warnings"]:
        lines += ["Warnings", *(f"  - {sentence}" for sentence in result["warnings"]), ""]
    lines.append("Probability of each class" + (" (not to be used: see above)" if set_aside else ""))
    for c in result["classes"]:
        lines.append(
            f"  {c['mass_range']:{width}}  {percent(c['probability']):>14}  ({interval(c)}); PDF evidence: "
            f"{evidence_words(c, result)}"
        )
    lines.append(f"  {abundance_words(result)}")
    quality = result["quality"]
    lines += ["", f"Simulated streams observed like this one ({quality['n_held_out']} held out), in counts"]
    labels = [c["mass_range"] for c in result["classes"]]
    cell = max(12, width + 2)
    lines.append("  " + " " * (width + 6) + "".join(f"{label:>{cell}}" for label in labels) + "  (taken for)")
    for label, row in zip(labels, quality["confusion"], strict=True):
        lines.append(f"  true {label:{width}} " + "".join(f"{n:{cell}d}" for n in row))
    lines.append(
        f"  right: {right_share(quality)}; calibration "
        f"error {quality['calibration_error']:.3f}; PDF evidence alone: "
        f"{100 * quality['pdf_accuracy']:.1f} % right"
    )
    if result["robustness"]:
        lines += ["", "Does it hold?", *(f"  {line}" for line in robustness_lines(result))]
    parts = (
        ("Assumed", result["assumptions"]),
        ("Mind", result["caveats"]),
        ("Where this comes from", provenance_words(result)),
    )
    for title, sentences in parts:
        lines += ["", title, *(f"  - {sentence}" for sentence in sentences)]
    return "\n".join(lines)
