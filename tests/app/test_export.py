"""All of a page as one ZIP with a notebook that runs, and views that are pinned."""

from __future__ import annotations

import io
import json
import zipfile

import pandas as pd

from app.ui.bundle import bundle
from streamdash.config import EnsembleConfig

PDF = "?page=pdf&mass=1e3-1e5,1e5-1e9&noise=0.2&n_bin=12"


def test_a_page_is_one_zip_with_figures_numbers_configs_and_a_notebook_that_runs(
    open_shell, shipped_cache, tmp_path, monkeypatch
):
    page = open_shell(PDF).page
    archive = zipfile.ZipFile(io.BytesIO(bundle(page.bundled)))
    names = archive.namelist()
    for card in ("pdf", "pdf-bin"):
        stem = f"{card}/streamdash_{card}_1e3-1e5_1e5-1e9_noise0.2_bins12"
        assert {f"{stem}.{kind}" for kind in ("png", "svg", "pdf", "csv")} < set(names)
    table = pd.read_csv(archive.open("pdf/streamdash_pdf_1e3-1e5_1e5-1e9_noise0.2_bins12.csv"), comment="#")
    pd.testing.assert_frame_equal(
        table, pd.read_csv(io.BytesIO(page.card.files["csv"]()), comment="#"), check_exact=False
    )
    configs = [name for name in names if name.startswith("configs/")]
    assert [EnsembleConfig.parse(archive.read(name)) for name in configs] == page.session.configs
    cells = json.loads(archive.read("notebook.ipynb"))["cells"]
    assert len({cell["id"] for cell in cells}) == len(cells) == 4
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("STREAMDASH_CACHE", str(shipped_cache))
    for cell in cells:
        if cell["cell_type"] == "code":
            exec(cell["source"].partition("\nfrom IPython")[0], {})
    assert (tmp_path / "pdf.png").read_bytes().startswith(b"\x89PNG") and (tmp_path / "pdf-bin.png").exists()


def test_a_pinned_view_stays_beside_the_next_one(open_shell):
    shell = open_shell(PDF)
    page = shell.page
    assert not page.card._pinned.visible
    page.card.pin()
    before = page.card._pinned[1].object
    shell.session.noise = 0.5
    assert page.card._pinned[1].object == before != page.card.files["png"]()
    assert "= 0.2" in page.card._pinned[2].object and "noise=0.2" in page.card._pinned[3].links[0][1]
    shell.session.mass = [choice.key for choice in shell.session.catalog.streams[0].ensembles[:3]]
    assert shell.page is not page and shell.page.card._pinned.visible  # other classes, another page
    shell.page.card.unpin()
    assert not shell.page.card._pinned.visible and not shell.session.pinned
