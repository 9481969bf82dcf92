"""The command `validate markers`: predictions compared with a marker detector."""

from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console

from rastercov.cli import SETTINGS
from rastercov.cli.console import out_option, progress_bar
from rastercov.cli.help import Command, Group
from rastercov.cli.options import AsJson

app = typer.Typer(
    help="Hold the model against what a real task makes of pictures.", cls=Group, **SETTINGS
)


@app.callback()
def _group() -> None:
    """Hold the model against what a real task makes of pictures."""


@app.command(cls=Command)
def markers(
    out: Annotated[Path, out_option("Folder for the page.")] = Path("markers"),
    scenes: Annotated[
        int, typer.Option(min=0, help="Random scenes; 0 leaves only the thesis' experiments.")
    ] = 2000,
    seed: Annotated[int, typer.Option(min=0, help="Of the random scenes.")] = 2020,
    obstacle: Annotated[
        float,
        typer.Option(min=0.01, max=2.0, help="Size of what is in the way: 0.3 is a plate, metres."),
    ] = 0.30,
    failures: Annotated[int, typer.Option(min=0, help="Failures to show.")] = 24,
    device: Annotated[
        str, typer.Option(help="OpenGL device: auto, egl:0, surfaceless, osmesa.")
    ] = "auto",
    as_json: AsJson = False,
) -> None:
    """Predict which ArUco markers OpenCV finds in pictures; 1 when under 98 % are right.

    The four experiments of the thesis, and random scenes by every model. It leaves a page for
    people (markers.html) and all figures (markers.json). With few scenes chance decides. Needs the
    extra `markers`.

    [bold]Example[/]: rastercov validate markers --out markers/

    [bold]In seconds[/]: rastercov validate markers --scenes 0
    """
    from rastercov.base.output import json_text
    from rastercov.reference.markers.detect import patterns
    from rastercov.reference.markers.experiments import run_experiments
    from rastercov.reference.markers.random_scenes import models, run_random
    from rastercov.reference.markers.render import MarkerRenderer
    from rastercov.reference.markers.report import (
        REQUIREMENTS,
        VALIDATION,
        Validation,
        experiment_table,
        score_table,
        write_validation,
    )
    from rastercov.reference.markers.report import as_json as figures
    from rastercov.report.folder import ReportFolder

    with ReportFolder(out, VALIDATION) as folder, MarkerRenderer(patterns(), device) as renderer:
        with progress_bar() as progress:
            experiments = run_experiments(renderer, seed, progress)
        study = None
        if scenes:
            with progress_bar() as progress:
                study = run_random(
                    renderer, scenes, seed, models(), obstacle=obstacle, progress=progress
                )
        found = Validation(experiments, study, renderer.renderer)
        with progress_bar() as progress:
            path = write_validation(folder, found, renderer, failures, progress)
    if as_json:
        print(json_text(figures(found)))
    else:
        console = Console()
        for experiment in experiments:
            console.print(experiment_table(experiment))
        if study:
            for requirement in REQUIREMENTS:
                scores = [s for s in study.scores if s.requirement == requirement.name]
                console.print(score_table(scores))
        print("\n".join(found.lines()))
        print(path)
    if not found.passed:
        raise typer.Exit(1)
