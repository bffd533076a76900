"""The story's words. Every number comes as an argument, computed when the text is shown."""

from __future__ import annotations

import math

GLOSSARY = """
| word or symbol | meaning |
|---|---|
| **b** | impact parameter, or closest approach: the distance at which an object passes the stream |
| **Bayes factor, ln B** | how much more probable an observation is under one hypothesis than under another, and its natural logarithm |
| **bin** | a short stretch of the stream in which stars are counted together |
| **classifier** | a program that has seen many simulated streams with their answers and guesses the answer of a new one |
| **δΩ∥** | by how much a fly-by changes a star’s drift along the stream |
| **fiducial** | the hypothesis that is taken to be true while one asks how sure one could be of it |
| **Gyr** | gigayear, a billion years |
| **kpc, pc** | kiloparsec, parsec: lengths; light takes 3.26 years for one parsec |
| **ℓ (deg)** | Galactic longitude; with the Galactic latitude it gives the position on the sky as seen from the Sun |
| **φ₁, ξ (deg)** | longitude in a frame of the sky in which the stream lies nearly flat: φ₁ of GD-1, ξ of Palomar 5, counted from the cluster |
| **M☉** | the mass of the Sun |
| **M0, M1, …** | the hypotheses compared: mass ranges of the dark objects, lightest first |
| **Ω∥** | how fast stars drift along the stream, away from the progenitor (“omega parallel”) |
| **PDF(Qρ)** | probability density function: how often each value of Qρ occurs along a stream |
| **primordial black hole** | a black hole from the first moments of the Universe; no star made it |
| **progenitor** | the cluster of stars that the stream comes from |
| **Qρ** | density of the stream divided by that of the undisturbed stream, ρ / ρ̄; 1 where nothing has happened |
| **ρ, ρ̄** | number of stars per length of the stream (“rho”), with and without fly-bys |
| **r_s** | scale radius: the size of a dark object |
| **σ_ε** | shot noise: the scatter of Qρ in one bin that comes from counting a limited number of stars |
| **subhalo** | a clump of dark matter that orbits in the Galaxy |
| **θ∥** | angle along the stream, from the progenitor outwards, in radians (“theta parallel”) |
| **tide** | the difference of a pull between the near and the far side of what is pulled |
"""
# ruff: noqa: E501


def stream_text(
    name: str,
    leading: bool,
    symbol: str,
    galactic: bool,
    age: float,
    sky: float,
    near: float,
    far: float,
    drift: float,
    length: float,
) -> str:
    """The stream; `symbol` is of the longitude of the stream's frame, in which it is shown unless `galactic`."""
    leave = (
        "Some leave inwards, where orbits are quicker,\nand run ahead"
        if leading
        else "Some leave outwards, where orbits are slower,\nand fall behind"
    )
    half = "runs ahead" if leading else "falls behind"
    where = "Two coordinates say where along it we are: Galactic longitude **ℓ**, as seen in the sky, and the angle"
    if not galactic:
        where = (
            f"On the map the stream lies in Galactic longitude **ℓ** and latitude. Two coordinates say where "
            f"along it we are: **{symbol}**, the longitude of a frame of the sky in which the stream lies nearly "
            "flat, and the angle"
        )
    return f"""
A cluster of stars that orbits the Galaxy is pulled harder on its near side than on its far side. This
*tide* lets its outer stars go, slowly and a few at a time. {leave}. Over billions of years they draw out
a thin band along the orbit: a **stellar stream**. The big dot marks the cluster it comes from, the
*progenitor*.

This stream is a model ({name}). It began to come apart **{age:g} Gyr** ago; a Gyr is a billion years. The
half that {half} now spans **{sky:.0f}°** of the sky, {near:.0f} to {far:.0f} kpc from us.

{where}
**θ∥** from the progenitor, in radians. Stars drift outwards by {drift:.2g} rad per Gyr on average, so the
far end, at {length:.2f} rad, left first. The number of stars per length is the density **ρ**; as long as
nothing disturbs the stream it is smooth, and then it is called **ρ̄**.
"""


def mystery_text(noise: float, low: float, high: float) -> str:
    """How it begins."""
    return f"""
Here is a stream of stars, counted piece by piece along the sky. Where the counts are high, stars have gathered;
where they are low, there is a **gap**. An undisturbed stream would give the dashed line.

Averaged over a few degrees these counts go from **{low:.2f}** to **{high:.2f}** of what is expected; counting
alone blurs every dot by {noise:g}. Something came by and left these marks. Nobody saw it: it gives no light.

**Who made this gap?** By the end you will have weighed it.
"""


def orbits_text(kick: float, real: float) -> str:
    """Pulled forward falls back."""
    return f"""
Three stars start from one place on one orbit. One is left alone. One is *pulled forward*: it gains **{kick:g}
km/s**. One is *held back* and loses as much.

Who will be ahead? Think of a race on a round track, and then play the film. The orbits are computed in the
pull of the whole Galaxy; only the kick is enlarged, to be seen at once. A real fly-by of the next step gives
**{real:.2g} km/s**, and has billions of years.
"""


def odds_text(
    light: str, heavy: str, colours: tuple[str, str], low: float, high: float, value: float, odds: float
) -> str:
    """One number, two explanations."""
    winner, factor = (light, odds) if odds >= 1 else (heavy, 1 / odds)
    return f"""
Take one number from a stream: how much of it lies within {low:.2f} < Qρ < {high:.2f}, close to undisturbed (as a
density per unit of Qρ). The figure shows how often each value occurs in streams hit by {light} ({colours[0]})
and in streams hit by {heavy} ({colours[1]}).

Now one new stream has **{value:.2f}** (vertical line). Read off both curves there: it is **{factor:.3g} times** as
common for {winner}. If both were equally likely before, these are the **odds** now.

That is all there is to evidence: how often would each explanation give what was seen? Draw others and see
how the odds differ from stream to stream.
"""


def solved_text(name: str, hits: int, value: str, usual: str) -> str:
    """Whose gap it was."""
    return f"""
The stream of the first page was one of ours: it was hit by **{hits}** objects of **{name}**. The coloured line
is the same stream without the scatter of counting.

What gives it away most is one number: {value}. Of the streams hit by {name}, 68 % have {usual}.

And the real one? The stream **GD-1** has a gap that no known cluster or cloud has made. Its star counts belong
to their authors and do not come with this program. Open the *Observe* page: it has an example of the same
form, made by simulation, and takes the real counts if you have them as a file.
"""


def gap_text(mass: str, r_s: str, b: str, speed: float, kick: float, time: float, missing: float) -> str:
    """One fly-by."""
    return f"""
Dark matter is expected to come in clumps. We cannot see one, but a stream can feel it. Let an object of
**mass10~{mass}** (M☉ is the mass of the Sun) and size {r_s} pass at {b}. For a moment it pulls on the stars
nearby. That *kick* changes their velocity along the stream by at most **{kick:.2g} km/s**, while they
orbit at {speed:.0f} km/s.

Stars behind the point that was hit are pulled forward, and fall back. Stars ahead are pulled back, and run
away. Both leave the place that was hit, and a **gap** opens.

Here the fly-by was {time:.1f} Gyr ago. Today, where the stream is emptiest, **{missing:.0f} %** of its stars
are missing (line: today; dashed: without the fly-by). Drag the mass and see how the gap answers.
"""


def many_text(
    light: str,
    heavy: str,
    colours: tuple[str, str],
    hits: tuple[float, float],
    size: tuple[float, float],
    n: tuple[int, int],
) -> str:
    """Many of them."""
    return f"""
A stream is hit more than once. If the dark objects have **{light}** each ({colours[0]}), this one
is hit **{hits[0]:.0f}** times on average; if they have **{heavy}** ({colours[1]}), **{hits[1]:.0f}** times. Many gaps overlap,
refill and are hit again: no single one can be traced back any more. What is left is a pattern.

To see the pattern alone, divide the density by that of the undisturbed stream: **Qρ = ρ / ρ̄**. It is 1
where nothing has changed, 0 where no star is left. The lines are one simulated stream for each of the mass
ranges. In the middle one of {n[0]} streams hit by {light} Qρ goes up and down by **{size[0]:.2g}**; in the middle
one of {n[1]} hit by {heavy} by **{size[1]:.2g}**.

Draw others: every stream is different, as every throw of dice is, but each kind keeps its character.
"""


def noise_text(
    noise: float,
    stars: float,
    n_bin: int,
    width: float,
    light: str,
    heavy: str,
    colours: tuple[str, str],
    share: tuple[float, float],
) -> str:
    """The telescope."""
    counted = (
        f"**noise~σ_ε = {noise:g}** means about **{stars:.0f} stars** per bin."
        if math.isfinite(stars)
        else "**noise~σ_ε = 0** would take endlessly many stars."
    )
    return f"""
A telescope counts stars, here in {n_bin} *bins* of {width:.1f}° along the stream. Even where the density is
smooth, counts scatter: of N stars expected, one finds N give or take √N. This **shot noise**, relative to
the smooth density, is called **σ_ε** (“sigma epsilon”), and σ_ε = 1/√N. {counted}

The dots are the streams of before as such a telescope would see them. (Here, as in the paper, every bin is
given the same Gaussian scatter; where that is large, some dots fall below 0, as no real count can.) A bin
says something only if it is off by more than the noise. Without noise, **{share[0]:.0f} %** of all bins of streams hit by {light}
({colours[0]}) are farther than {noise:g} from Qρ = 1, and **{share[1]:.0f} %** of those hit by {heavy}
({colours[1]}).

Drag the noise up, and watch the quieter streams disappear first.
"""


def evidence_text(
    light: str,
    heavy: str,
    colours: tuple[str, str],
    right: tuple[str, str],
    ln_bayes: tuple[float, float],
    n_bin: int,
) -> str:
    """The evidence."""
    return f"""
Which masses made a pattern that we see? Forget where along the stream each value of Qρ is, and count how
often it occurs. That is **PDF(Qρ)**, the *probability density function*. Each mass range has a typical one
(line), which 68 % of its streams follow within the coloured band. Where bands are apart, a measurement can
decide.

How well? Learn the PDFs from one half of the streams and judge the other half by them. The truth wins for
**{right[0]}** of the streams hit by {light} ({colours[0]}) and for **{right[1]}** of those hit by
{heavy} ({colours[1]}).

Statisticians put it as the *Bayes factor* B: how many times more probable the data are if one mass range is
true than if the other is. Bin by bin the logarithms, ln B, can be added; over {n_bin} bins they make
{ln_bayes[0]:z.1f} for {light} and {ln_bayes[1]:z.1f} for {heavy}. Such sums promise too much, because
neighbouring bins are not independent. That is why the number to trust is the share of streams put right.
"""


def question_text(
    light: str,
    heavy: str,
    colours: tuple[str, str],
    noise: float,
    seen: tuple[float, float],
    single: float,
    width: float,
    stars: tuple[float, float],
) -> str:
    """The question."""
    words = []
    for name, colour, length in zip((light, heavy), colours, seen, strict=True):
        name = f"{name} ({colour})"
        if math.isfinite(length):
            words.append(f"those of {name} in pieces of **{length:.1f}°** and longer")
        else:
            words.append(f"those of {name} in none of these pieces")
    more = ""
    if math.isfinite(stars[1]):
        ratio = stars[0] / stars[1]
        more = f", {ratio:.2g} times as many as at this noise" if ratio > 1 else ", fewer than at this noise"
    return f"""
Black holes may have formed in the first moments of the Universe. If such **primordial black holes** are
the dark matter and gather in clusters of {light}, each cluster kicks only softly. Would we notice?

Cut the streams into pieces and ask how far a piece’s density is from the smooth one. In longer pieces noise
averages out (dashed), while the ups and downs of the stream remain (lines; bars hold 68 % of the streams). At
**noise~σ_ε = {noise:g}** the ups and downs exceed the noise as follows: {words[0]}; {words[1]}.

To see {light} in single bins of {width:.1f}° takes σ_ε below **{single:.2g}**: about
**{stars[0]:.0f} stars** per bin{more}. And to see is not yet to know: heavier objects make gaps, too. To tell
the masses apart takes the whole pattern, which is what the other pages weigh.
"""
