"""What is said of an answer promises no more than its numbers."""

import pytest

from streamdash.observe.misfit import ERRORS
from streamdash.observe.report import agreement, answer, verdict_of, warnings
from streamdash.observe.resemblance import DOUBTFUL, UNLIKE


def told(p: float, first: float, ln_bayes: float = -9.0, detected: bool = True, kind: str = "") -> dict:
    """A report of two classes with a p-value and a probability of the first."""
    verdict = "unlike" if p < UNLIKE else "unusual" if p < DOUBTFUL else "alike"
    result = {
        "resemblance": {"verdict": verdict, "p": p},
        "detected": detected,
        "resembles": verdict != "unlike",
        "smooth_p": 1e-3 if detected else 0.3,
        "classes": [
            {
                "mass_range": "1e3-1e5",
                "probability": first,
                "low": first - 0.004,
                "high": 1.0,
                "ln_bayes": 0.0,
            },
            {"mass_range": "1e5-1e9", "probability": 1 - first, "low": 0, "high": 0.5, "ln_bayes": ln_bayes},
        ],
        "quality": {"accuracy": 0.873, "pdf_accuracy": 0.71},
        "hangs_on": {"kind": kind, "p": 0.01 if kind else 1.0},
    }
    return {**result, "verdict": verdict_of(result)}


@pytest.mark.parametrize(
    ("p", "first", "words"),
    [
        (0.4, 0.93, "looks more like a stream perturbed by 10³–10⁵ M☉ than by 10⁵–10⁹ M☉: probability 93 %"),
        (0.4, 0.93, "the method is right for 87 % of simulated streams"),
        (0.4, 0.9999, "probability more than 99 % (68 % interval more than 99 %)"),
        (0.4, 0.6, "does not decide between the classes"),
        (0.02, 0.93, "Though an unusual profile for any class (p = 0.02), it looks more like"),
        (0.005, 0.93, "at most about 1 in 200 look as strange (p = 0.005)"),
    ],
)
def test_the_sentence_says_no_more_than_the_numbers(p, first, words):
    assert words in answer(told(p, first))


def test_the_first_word_says_what_kind_of_answer_it_is():
    assert answer(told(0.4, 0.93)).startswith("Decided. This profile looks more like")
    assert answer(told(0.4, 0.6)).startswith("Undecided. This profile does not decide")
    assert answer(told(0.4, 0.93, ln_bayes=9.0)).startswith("Undecided. ")  # the methods clash strongly
    assert answer(told(0.004, 0.93)).startswith("Unlike anything simulated. ")
    nothing = answer(told(0.4, 0.93, detected=False))
    assert nothing.startswith("Nothing detected. No perturbation is seen at this noise")
    assert "(p = 0.3). If one of these classes hit the stream all the same: This profile" in nothing


def test_warnings_are_none_where_nothing_is_doubtful_and_name_what_is():
    assert warnings(told(0.4, 0.93)) == []
    assert "strong evidence for 10⁵–10⁹ M☉ instead" in warnings(told(0.4, 0.93, ln_bayes=9.0))[0]
    assert warnings(told(0.4, 0.93, detected=False)) == []  # an answer; no class is claimed
    assert warnings(told(0.4, 0.93, ln_bayes=9.0, detected=False)) == []
    assert not any("unusual" in words for words in warnings(told(0.02, 0.93)))  # the answer says so
    misled = told(0.4, 0.93, kind=ERRORS)
    assert warnings(misled)[0].startswith("The errors decide.")
    assert answer(misled).startswith("Undecided. The errors decide.") and "probability 93 %" in answer(misled)
    nested = told(0.4, 0.93)
    nested["classes"][0]["mass_range"] = "1e5-1e7"
    assert "do not exclude one another" in warnings(nested)[0]
    assert answer(nested).startswith("Decided. 10⁵–10⁹ M☉ holds 10⁵–10⁷ M☉: the two do not exclude")


def test_methods_that_disagree_are_said_to():
    assert "also prefers 10³–10⁵ M☉" in agreement(told(0.4, 0.93))
    assert "The two methods disagree" in agreement(told(0.4, 0.2))
    assert "right for 71 %" in agreement(told(0.4, 0.2))
    assert agreement(told(0.005, 0.2)) == ""
