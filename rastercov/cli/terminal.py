"""Tables and progress, by Rich, which not every command loads."""

import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager

from rich import console
from rich.console import RenderableType
from rich.segment import Segment

from rastercov.base import ReadByName, first_of
from rastercov.cli.console import ProgressLines, plain, show_lines


class Console(console.Console):
    """Console of Rich, which leaves a broken pipe to us: its own ends the process with 1."""

    def on_broken_pipe(self) -> None:
        """Raise the error again."""
        raise

    def render(
        self, renderable: RenderableType, options: console.ConsoleOptions | None = None
    ) -> Iterator[Segment]:
        """Segments of `plain` text, whatever the names in it hold."""
        for text, style, control in super().render(renderable, options):
            lines = [text] if control else map(plain, text.split("\n"))
            yield Segment("\n".join(lines), style, control)


def print_rows(table: RenderableType) -> None:
    """Print a list as a table, a line a row where it is read by a program."""
    Console(width=None if sys.stdout.isatty() else 10_000).print(table)


def print_network(
    summary: ReadByName, level: int | None, *, has_parts: bool = True, unit: str = "m"
) -> None:
    """Print a table of the parts that cameras cover, where there are several, and their types."""
    from rastercov.placement.parts import part_rows
    from rastercov.report.tables import shares_by_type, summary_table

    console = Console()
    if has_parts and (level is not None or len(part_rows(summary)) > 1):
        console.print(summary_table(summary, level, unit))
    if rows := shares_by_type(summary):
        print(f"Covered by each camera type alone: {first_of(rows)}")


@contextmanager
def progress_bar(what: str = "poses", then: str = "") -> Iterator[Callable[[int, int], None]]:
    """Progress with the time left: a bar on a terminal, lines on standard error elsewhere.

    Lines after the last report name what comes `then`, such as "report"; a count from 0 after it is
    of that.
    The time counts from the first report on: what an earlier run had done says nothing about it.
    """
    console = Console(stderr=True)
    if not (console.is_terminal and sys.stderr.isatty()):  # whatever FORCE_COLOR says
        lines = ProgressLines(what, then)
        with show_lines(lines):
            yield lines
        return
    from rich.progress import (
        BarColumn,
        MofNCompleteColumn,
        Progress,
        TextColumn,
        TimeRemainingColumn,
    )

    columns = (
        TextColumn("{task.description}"),
        BarColumn(),
        MofNCompleteColumn(),
        TimeRemainingColumn(),
    )
    with Progress(*columns, console=console, transient=True) as bar:
        task = bar.add_task(what, total=None, start=False)

        def update(done: int, total: int) -> None:
            own = bar.tasks[0]
            if own.started and not (own.finished and done == 0):
                bar.update(task, completed=done, total=total)
            else:
                name = then if own.finished and then else own.description
                bar.reset(task, completed=done, total=total, description=name)

        yield update
