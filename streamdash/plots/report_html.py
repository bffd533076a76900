"""The report on an observation as one HTML file: no scripts, nothing fetched, every text escaped."""

from __future__ import annotations

import html
import json
from typing import Any

import numpy as np

from streamdash.naming import class_colour
from streamdash.observe.observation import Observation
from streamdash.observe.provenance import provenance_words
from streamdash.observe.report import evidence_words, interval, name, percent, resemblance_words
from streamdash.plots import observe
from streamdash.plots.live import export

STYLE = """
body { font: 16px/1.5 system-ui, sans-serif; max-width: 60rem; margin: 2rem auto; padding: 0 1rem; }
table { border-collapse: collapse; margin: .5rem 0; } th, td { padding: .3rem .8rem; text-align: right; }
th:first-child, td:first-child { text-align: left; white-space: nowrap; }
thead th { border-bottom: 1px solid #808080; }
.answer { font-size: 1.3rem; border-left: 6px solid #17456b; padding: .4rem 1rem; }
.unlike { border-color: #b3261e; } .aside { opacity: .45; } svg { max-width: 100%; height: auto; }
pre { overflow-x: auto; font-size: .75rem; }
"""
POLICY = "default-src 'none'; style-src 'unsafe-inline'"


def report_html(result: dict[str, Any], observation: Observation, bands: np.ndarray) -> str:
    """The whole report, figure and numbers included.

    Parameters
    ----------
    result : from `streamdash.observe.report.report`
    observation : what it is about
    bands : from `streamdash.observe.verdict.Prepared.bands`
    """
    figure = export(observe.draw(observation, bands, "matplotlib"), "svg").decode()
    unlike = result["resemblance"]["verdict"] == "unlike"
    data = html.escape(json.dumps(result, indent=1, ensure_ascii=False))
    return (
        "<!doctype html><html lang='en'><head><meta charset='utf-8'>"
        f'<meta http-equiv="Content-Security-Policy" content="{POLICY}">'
        "<meta name='viewport' content='width=device-width'><title>streamdash: a measured profile</title>"
        f"<style>{STYLE}</style></head><body><h1>Which perturbers made these gaps?</h1>"
        f"<p class='answer{' unlike' if unlike else ''}'>{html.escape(result['answer'])}</p>"
        f"<p>{html.escape(result['agreement'])}</p>"
        f"{result_tables(result)}"
        "<h2>The profile over the classes</h2><p>Dots: measured. Bands: where 68 % of the simulated streams "
        f"of each class lie when observed alike; lines: medians.</p>{figure[figure.index('<svg') :]}"
        f"<h2>What was assumed</h2>{_list(result['assumptions'])}"
        f"<h2>Mind</h2>{_list(result['caveats'])}"
        f"<h2>Where this comes from</h2>{_list(provenance_words(result))}"
        "<details><summary>All numbers, as JSON</summary>"
        f"<pre>{data}</pre></details></body></html>"
    )


def result_tables(result: dict[str, Any]) -> str:
    """Resemblance, probabilities, evidence and the held-out matrix as HTML."""
    quality = result["quality"]
    aside = " class='aside'" if result["resemblance"]["verdict"] == "unlike" else ""
    rows = "".join(
        f"<tr><th scope='row'>{_mark(i)} {html.escape(name(c))}</th><td>{percent(c['probability'])}</td>"
        f"<td>{html.escape(interval(c).removeprefix('68 % interval '))}</td>"
        f"<td>{html.escape(evidence_words(c, result))}</td></tr>"
        for i, c in enumerate(result["classes"])
    )
    heads = "".join(f"<th scope='col'>{html.escape(name(c))}</th>" for c in result["classes"])
    cells = "".join(
        f"<tr><th scope='row'>{_mark(i)} {html.escape(name(c))}</th>"
        + "".join(f"<td>{n} ({100 * n / max(sum(row), 1):.0f} %)</td>" for n in row)
        + "</tr>"
        for i, (c, row) in enumerate(zip(result["classes"], quality["confusion"], strict=True))
    )
    return (
        f"<h2>Is it like anything simulated?</h2><p>{html.escape(resemblance_words(result))}</p>"
        f"<h2>Classes</h2><table{aside}><thead><tr><th scope='col'>Perturbers</th>"
        "<th scope='col'>Probability</th><th scope='col'>68 % interval</th><th scope='col'>PDF evidence</th>"
        f"</tr></thead><tbody>{rows}</tbody></table>"
        "<h2>How good is the method with such data?</h2>"
        f"<p>With bins and errors like these it puts {100 * quality['accuracy']:.1f} ± "
        f"{100 * quality['accuracy_error']:.1f} % of {quality['n_held_out']} held-out simulated streams "
        f"right (calibration error {quality['calibration_error']:.3f}); PDF evidence alone "
        f"{100 * quality['pdf_accuracy']:.1f} %.</p>"
        f"<table><thead><tr><th scope='col'>True class, taken for</th>{heads}</tr></thead>"
        f"<tbody>{cells}</tbody></table>"
    )


def _mark(i: int) -> str:
    return f"<span style='color:{class_colour(i)}' aria-hidden='true'>■</span>"


def _list(sentences: list[str]) -> str:
    return "<ul>" + "".join(f"<li>{html.escape(sentence)}</li>" for sentence in sentences) + "</ul>"
