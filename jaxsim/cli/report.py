"""Output of commands to the terminal: reports on standard output, notes on standard error."""

import contextlib
from collections.abc import Iterable, Iterator, Mapping

import rich
import rich.console
import rich.table
import rich.text


def report(rows: Mapping[str, str]) -> None:
    """Print a table of two columns, without interpreting markup."""
    table = rich.table.Table(show_header=False, box=None)
    table.add_column(style="bold", no_wrap=True)
    table.add_column()
    for name, value in rows.items():
        table.add_row(name, rich.text.Text(value))
    rich.print(table)


def listing(name: str, sizes: Iterable[str], about: str, rows: Iterable[Iterable[object]]) -> None:
    """Print a table of names with sizes and a sentence each, without interpreting markup."""
    table = rich.table.Table(box=None)
    table.add_column(name, no_wrap=True)
    for size in sizes:
        table.add_column(size, justify="right")
    table.add_column(about)
    for row in rows:
        table.add_row(*(rich.text.Text(str(cell)) for cell in row))
    rich.print(table)


@contextlib.contextmanager
def working(text: str) -> Iterator[None]:
    """Say what goes on while it does: with a moving sign on a terminal, or else once."""
    console = rich.console.Console(stderr=True, soft_wrap=True)
    if not console.is_terminal:
        note(text)
        yield
        return
    with console.status(rich.text.Text(text)):
        yield


def note(text: str) -> None:
    """Print a sentence for the user, without interpreting markup."""
    rich.console.Console(stderr=True, soft_wrap=True).print(text, markup=False)
