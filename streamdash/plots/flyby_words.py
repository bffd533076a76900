"""What the figures of single fly-bys show, in words and as tables."""

from __future__ import annotations

import numpy as np
import pandas as pd
import xarray as xr

from streamdash.engine.flyby import Film, Flyby, flyby_impacts
from streamdash.engine.galpy_streams import V0_KMS, time_unit_gyr
from streamdash.engine.geometry import TABLE_STEP, Geometry
from streamdash.naming import MASS_UNIT, SUPERSCRIPT
from streamdash.plots.style import coordinate_symbol
from streamdash.survey.flyby import Scene, Seen

FLAT = 0.005
"""Share of missing stars below which there is no gap to speak of."""


def film_table(shown: Film) -> pd.DataFrame:
    """All frames as one table."""
    n_frames, n_theta = shown.density.shape
    return pd.DataFrame(
        {
            "gyr_before_today": np.repeat(shown.time_gyr, n_theta),
            "theta_rad": np.tile(shown.theta, n_frames),
            "density": shown.density.ravel(),
            "smooth": shown.smooth.ravel(),
            "q_rho": shown.q_rho.ravel(),
        }
    )


def kick_table(kick: xr.Dataset) -> pd.DataFrame:
    """Both kicks along the stream."""
    names = {"theta": "theta_rad", "dv_along": "dv_along_kms", "dv_across": "dv_across_kms"}
    return kick.to_dataframe().reset_index().rename(columns={**names, "d_omega": "d_omega_rad_per_gyr"})


def seen_table(seen: Seen) -> pd.DataFrame:
    """Today's profile per bin."""
    return pd.DataFrame(
        {
            f"{seen.coordinate}_deg": seen.position,
            "q_rho": seen.clean,
            "q_rho_noisy": seen.noisy,
            "q_rho_in_hand_alone": seen.alone,
        }
    )


def captions(shown: Film) -> list[str]:
    """What is said of each frame."""
    return [
        f"{shown.time_gyr[0] - time:.2f} Gyr after the first fly-by · "
        + (f"{time:.2f} Gyr before today" if time > 0 else "today")
        for time in shown.time_gyr
    ]


def hand_sentence(geometry: Geometry, scene: Scene) -> str:
    """The fly-by in hand, in numbers."""
    flyby = scene.flybys[-1]
    impact = flyby_impacts(geometry, [flyby])
    w = np.array([impact.vx_kms[0], impact.vy_kms[0], impact.vz_kms[0]])
    relative = float(np.linalg.norm(w - _star_velocity(geometry, flyby)))
    which = f"Fly-by {len(scene.flybys)}, in hand" if len(scene.flybys) > 1 else "The fly-by in hand"
    return (
        f"{which}: {mass_words(flyby.mass_msun)} with scale radius r_s = {length_words(flyby.r_s_kpc)} "
        f"passed the stream at {length_words(impact.b_kpc[0])}, with {relative:.0f} km/s relative to it, "
        f"{impact.time_gyr[0]:.2f} Gyr before today, where θ∥ was {impact.theta[0]:.2f} rad."
    )


def star_speed(geometry: Geometry, flyby: Flyby) -> float:
    """Speed of the stars that the fly-by meets, km/s."""
    return float(np.linalg.norm(_star_velocity(geometry, flyby)))


def _star_velocity(geometry: Geometry, flyby: Flyby) -> np.ndarray:
    """Velocity (3,) of the stars that the fly-by meets, km/s."""
    table = geometry.tables[flyby.time_index(geometry)]
    return table[min(round(flyby.angle(geometry) / TABLE_STEP), len(table) - 1), 3:6] * V0_KMS


def _percent(share: float) -> str:
    return f"{100 * share:.0f}" if share >= 0.1 else f"{100 * share:.2g}"


def _pile(q: float) -> str:
    """How many stars there are where most have gathered."""
    if q >= 2:
        return f"up to {q:.2g} times as many as"
    return f"up to {_percent(max(q - 1, 0.0))} % more than"


def mass_words(mass: float) -> str:
    """A mass for people, for example ``3.2·10⁷ M☉``."""
    power = int(np.floor(np.log10(mass) + 1e-9))
    return f"{mass / 10**power:.1f}·10{str(power).translate(SUPERSCRIPT)} {MASS_UNIT}"


def length_words(kpc: float) -> str:
    """A length for people, in kpc or pc."""
    return f"{kpc:.2g} kpc" if kpc >= 1 else f"{1000 * kpc:.3g} pc"


def film_sentence(shown: Film, frame: int) -> str:
    """What the frame shows."""
    q = shown.q_rho[frame]
    lowest = int(np.nanargmin(q))
    when = f"{shown.time_gyr[frame]:.2f} Gyr before today" if shown.time_gyr[frame] > 0 else "Today"
    depth = 1 - float(q[lowest])
    if depth < FLAT:
        opens = 1 - float(np.nanmin(shown.q_rho[-1])) >= FLAT
        why = "a kick takes time to open a gap" if opens else "so weak a kick opens no gap that could be seen"
        state = f"the density is within {100 * FLAT:g} % of that of a stream that nothing has hit: {why}."
    else:
        emptied = np.isfinite(q) & (q < 1 - 0.5 * depth)
        width = float(emptied.sum() * (shown.theta[1] - shown.theta[0]))
        state = (
            f"the emptiest place is at θ∥ = {shown.theta[lowest]:.2f} rad, where {100 * depth:.0f} % of the "
            f"stars are missing; {width:.2g} rad of the stream lack at least half as many. "
            f"They have not vanished: beside it there are {_pile(float(np.nanmax(q)))} without "
            "a fly-by."
        )
    return f"{when}, {state}"


def kick_sentence(geometry: Geometry, scene: Scene, kick: xr.Dataset) -> str:
    """What the fly-by in hand did."""
    flyby = scene.flybys[-1]
    speed = star_speed(geometry, flyby)
    strongest, turn = float(np.abs(kick.dv_along).max()), float(np.abs(kick.d_omega).max())
    share = turn * time_unit_gyr() / geometry.mean_omega
    return (
        f"Along the stream, stars that move at {speed:.0f} km/s are sped up or slowed down by at most "
        f"{strongest:.2g} km/s. Yet that changes the rate δΩ∥ at which they drift away from the progenitor "
        f"by up to {turn:.2g} rad/Gyr, {_percent(share)} % of the mean drift, and it acts for "
        f"{geometry.stream.impact_times_gyr[flyby.time_index(geometry)]:.2g} Gyr until today."
    )


def seen_sentence(seen: Seen) -> str:
    """What is seen today."""
    deepest = int(np.argmin(seen.clean))
    depth = 1 - float(seen.clean[deepest])
    where = f"{coordinate_symbol(seen.coordinate)} = {seen.position[deepest]:.1f}°"
    words = (
        f"Without noise the emptiest bin, at {where}, lacks {_percent(depth)} % of the stars of a stream "
        "that "
        f"nothing has hit (Qρ, their ratio, is {1 - depth:.2g})"
    )
    if seen.noise > 0:
        words += f": {depth / seen.noise:.2g} times the shot noise σ_ε = {seen.noise:g} of one bin"
    if seen.n_impacts == 1:
        return words + ". This is one fly-by alone."
    return (
        f"{words}. There are {seen.n_impacts} fly-bys; the one in hand (dashed) explains "
        f"{100 * seen.share:.0f} % of the pattern."
    )
