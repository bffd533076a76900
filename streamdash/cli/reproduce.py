"""``streamdash reproduce``: the paper's evidence, classifier, tables and figures from the cache."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from streamdash.cli.common import CacheOption, InputError, make_cache, messages

if TYPE_CHECKING:
    from streamdash.config import EnsembleConfig
    from streamdash.store.cache import Cache


def reproduce_command(
    output: Annotated[
        Path | None,
        typer.Option(
            "--output",
            "-o",
            metavar="DIR",
            show_default="the folder of the figures; without one, tables are only printed",
            help="Write the results there: tables as Markdown, CSV and JSON.",
        ),
    ] = None,
    figures: Annotated[
        Path | None,
        typer.Option(
            "--figures", metavar="DIR", help="Also draw figures 1 to 5 and those of the appendices."
        ),
    ] = None,
    choices: Annotated[
        bool, typer.Option("--choices", help="Also measure what each choice left open by the paper does.")
    ] = False,
    text: Annotated[
        Path | None,
        typer.Option(
            "--text", metavar="FILE.md", help="Also write where and why the numbers differ (with --choices)."
        ),
    ] = None,
    classifier: Annotated[
        bool,
        typer.Option(
            "--classifier/--no-classifier",
            help="Also train the classifiers of table 2, and one on each statistic.",
        ),
    ] = True,
    studies: Annotated[
        bool,
        typer.Option(
            "--studies", help="Also do the studies that the Classifier page shows at once; some minutes."
        ),
    ] = False,
    cache: CacheOption = None,
) -> None:
    """Redo the paper's model selection and its classifier; the paper's numbers stand beside."""
    from threadpoolctl import threadpool_limits

    from streamdash.paper.evidence import load_sample, measure
    from streamdash.paper.tables import table_csv, table_markdown
    from streamdash.simulation.geometry import load_geometry

    folder = output or figures
    for directory in {one for one in (folder, figures) if one is not None}:
        make_folder(directory)
    # All matrices are small: threads of the linear algebra cost as much as the work itself.
    with threadpool_limits(1, "blas"):
        where = make_cache(cache)
        sample = load_sample(where)
        results = measure(sample, load_geometry(sample.configs[0].stream, where))
        if choices or text is not None:
            from streamdash.paper.choices import measure_choices

            results["choices"] = measure_choices(where, sample)
        table = table_markdown(results)
        print(table, end="")
        keep(folder, {"results.json": results, "table1.csv": table_csv(results), "table1.md": table})
        if classifier:
            from streamdash.paper.classifier import classifier_markdown, classifier_results

            configs = dict(zip(sample.labels, sample.configs, strict=True))
            scores = classifier_results(where, configs)
            print(f"\n{classifier_markdown(scores)}", end="")
            keep(folder, {"classifier.json": scores, "table2.md": classifier_markdown(scores)})
            numbers, markdown = kept_by_statistics(where, configs)
            print(f"\n{markdown}", end="")
            keep(folder, {"statistics.json": numbers, "statistics.md": markdown})
            print(f"\n{reproduce_full_range(where, folder, figures)}", end="")
        if studies:
            from streamdash.paper.evidence import TWO_CLASSES
            from streamdash.paper.studies import study_results

            found = study_results(where, sample.only(TWO_CLASSES).configs)
            keep(folder, {"studies.json": found})
            for name, one in found["studies"].items():
                print(f"{name}: {one['seconds']:.0f} s of a processor")
        if text is not None:
            from streamdash.paper.differences import differences

            write(text, differences(rounded(results)))
        if figures is not None:
            from streamdash.plots.paper import save_appendix_figures, save_figures

            appendices, lacking = save_appendix_figures(where, sample, figures)
            for line in (*save_figures(where, sample, figures), *appendices, *lacking):
                messages.print(f"{line}", markup=False)


def kept_by_statistics(cache: Cache, configs: Mapping[str, EnsembleConfig]) -> tuple[list[Any], str]:
    """What the PDF, the power spectrum and the profile keep, for the paper's sets of classes.

    Returns
    -------
    numbers, markdown : the same as plain numbers and as tables.
    """
    from streamdash.paper.evidence import NOISE, THREE_CLASSES, TWO_CLASSES
    from streamdash.paper.statistics import compare_statistics, statistics_markdown, statistics_numbers
    from streamdash.survey.observed import ObservedStreams

    found = []
    for labels in (TWO_CLASSES, THREE_CLASSES):
        streams = ObservedStreams.read(cache, [configs[label] for label in labels])
        found.append(statistics_numbers(compare_statistics(streams, NOISE), labels, NOISE))
    return found, "\n".join(statistics_markdown(numbers) for numbers in found)


def reproduce_full_range(cache: Cache, folder: Path | None, figures: Path | None) -> str:
    """The paper's extension to the full range as Markdown, its files written; or which streams it lacks."""
    from streamdash.paper.full_range import full_range_markdown, full_range_results
    from streamdash.store.cache import StoreError

    try:
        results = full_range_results(cache)
    except StoreError as error:
        return f"{error}\n"
    markdown = full_range_markdown(results)
    keep(folder, {"full_range.json": results, "full_range.md": markdown})
    if figures is not None:
        from streamdash.plots.paper import save_full_range

        for path in save_full_range(results, figures):
            messages.print(f"{path}", markup=False)
    return markdown


def keep(folder: Path | None, files: Mapping[str, Any]) -> None:
    """Write results into a folder, where there is one: text as it is, all else as rounded JSON."""
    if folder is None:
        return
    for name, content in files.items():
        if not isinstance(content, str):
            content = json.dumps(rounded(content), indent=1, ensure_ascii=False) + "\n"
        write(folder / name, content)


def make_folder(directory: Path) -> None:
    """Make a folder and those above it.

    Raises
    ------
    InputError
        In one sentence, when that is not possible.
    """
    try:
        directory.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(f"The folder {directory} cannot be made ({error.strerror}).") from None


def write(path: Path, content: str) -> None:
    """Write a text file.

    Raises
    ------
    InputError
        In one sentence, when that is not possible.
    """
    try:
        path.write_text(content, encoding="utf-8")
    except OSError as error:
        raise InputError(f"{path} cannot be written ({error.strerror}).") from None


def rounded(value: Any) -> Any:
    """The same with numbers to six digits and NaN as null, so that files can be compared."""
    if isinstance(value, dict):
        return {name: rounded(part) for name, part in value.items()}
    if isinstance(value, list | tuple):
        return [rounded(part) for part in value]
    if isinstance(value, float):
        return float(f"{value:.6g}") if value == value else None
    return value
