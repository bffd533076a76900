"""Lines of Python that make the figure of the Observe page, and its answer, as they are now."""

from __future__ import annotations

from collections.abc import Sequence

from app.session.catalog import Choice
from app.session.listing import ensembles_code
from streamdash.observe.guess import Assumptions


def listing(choices: Sequence[Choice], assumptions: Assumptions, example: bool) -> str:
    """The listing of the card.

    Parameters
    ----------
    choices
        The classes that are compared.
    assumptions
        What the columns were taken for.
    example
        Whether the example is shown, or a file whose name only its owner knows.
    """
    file = "EXAMPLE" if example else 'Path("profile.csv")  # your table'
    lines = [
        "from pathlib import Path\n",
        "from streamdash.simulation.geometry import load_geometry",
        "from streamdash.observe.observation import interpret",
        "from streamdash.observe.guess import Assumptions",
        "from streamdash.observe.table import read_table",
        "from streamdash.plots.live import export",
        "from streamdash.plots.observe import draw",
        "from streamdash.observe.report import report, text",
        "from streamdash.store.cache import Cache",
        *(["from streamdash.survey.mock import EXAMPLE"] if example else []),
        "from streamdash.observe.verdict import judge, prepare\n",
        f"cache = Cache.default()\n{ensembles_code(choices).rstrip()}",
        f"file = {file}",
        f"assumptions = Assumptions.parse({assumptions.model_dump_json()!r})",
        "geometry = load_geometry(cache.find(ensembles[0]).config.stream, cache)",
        "observation = interpret(read_table(file.read_bytes()), assumptions, geometry)",
        "prepared = prepare(cache, ensembles, observation.design)",
        "print(text(report(judge(prepared, observation), observation, prepared)))",
        'figure = draw(observation, prepared.bands(), prepared.labels, "matplotlib")',
        'Path("observe.png").write_bytes(export(figure, "png"))',
    ]
    return "\n".join(lines) + "\n"
