"""What an answer about an observation does not cover, a sentence each."""

from __future__ import annotations

from streamdash.classifier import other_streams
from streamdash.naming import label_text
from streamdash.observe.observation import NAMES, Observation
from streamdash.observe.verdict import Prepared
from streamdash.observe.wording import percent
from streamdash.streams import stream_of
from streamdash.words import NEAR_PROGENITOR, PROGENITOR_WORDS, number_of


def caveats(observation: Observation, prepared: Prepared) -> list[str]:
    """What the answer does not cover, one sentence each."""
    design = observation.design
    n_streams = [len(q) for q in prepared.streams.q]
    n_near = observation.n_near
    bins = f"{n_near} of {number_of(design.n_bin, 'bin')} {'is' if n_near == 1 else 'are'}"
    near = [f"{bins} within θ∥ = {NEAR_PROGENITOR:g} of the progenitor. {PROGENITOR_WORDS}"] if n_near else []
    simulated = ""
    if max(n_streams) > min(n_streams):
        simulated = f", though {' and '.join(map(str, n_streams))} streams of them were simulated"
    unseen = (
        ["A polynomial was divided out: perturbations as broad as its waves are lost, in simulations too."]
        if design.order > 0
        else []
    )
    return [
        f"The answer is about {NAMES[design.coordinate]} from {design.low[0]:.1f}° to "
        f"{design.high[-1]:.1f}° only.",
        *stream_of(prepared.streams.configs[0].stream).caveats,
        "The measured stream has a history of its own, which no model of it knows.",
        "Only dark perturbers of the compared mass ranges at the rates simulated are considered; molecular "
        "clouds, spiral arms, the bar and globular clusters also make gaps and are not modelled.",
        f"All classes are taken to be equally likely beforehand{simulated}; mixtures are not considered.",
        "Errors are taken to be Gaussian, one standard deviation, and independent from bin to bin.",
        *_wrong_errors(prepared),
        *_other_streams(prepared),
        *unseen,
        *_refused(prepared),
        *near,
    ]


def _wrong_errors(prepared: Prepared) -> list[str]:
    if not prepared.wrong_errors:
        return []
    parts = " and ".join(f"{percent(share)} at {factor:g} times" for factor, share in prepared.wrong_errors)
    right = percent(float(prepared.judged.scores.values["overall_accuracy"]))
    return [
        "The probabilities hold if the errors are right. If they truly are others than stated, a classifier "
        f"that trusts them puts {parts} the stated errors right, instead of {right}; the Classifier page has "
        "the study."
    ]


def _other_streams(prepared: Prepared) -> list[str]:
    """What the shipped study of other rates and ages says of these classes, where it is of this stream."""
    labels = list(prepared.streams.labels)
    usual = all(other_streams.is_usual(config) for config in prepared.streams.configs)
    words = other_streams.caveat(other_streams.shipped_results(), labels) if usual else ""
    return [words] if words else []


def _refused(prepared: Prepared) -> list[str]:
    if max(prepared.refused, default=0.0) < 0.01:
        return []
    shares = " and ".join(
        f"{percent(share)} of {label_text(label)}"
        for label, share in zip(prepared.streams.labels, prepared.refused, strict=True)
        if share >= 0.01
    )
    return [
        f"The polynomial of order {prepared.design.order} comes close to zero for {shares}: such streams "
        "would be divided by a lower order, and are neither learnt from nor counted here."
    ]
