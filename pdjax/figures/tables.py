"""Tables as Markdown: text for a file, and what a notebook shows."""

from collections.abc import Iterable, Sequence


class Table(str):
    """Markdown that a notebook draws as a table when it is the last value of a cell or given to `display`."""

    __slots__ = ()

    def _repr_markdown_(self) -> str:
        return str(self)


def table(head: Sequence[str], rows: Iterable[Sequence]) -> Table:
    """A Markdown table of any values, one line a row; a bar within a cell is escaped.

    Raises: ValueError if a row has not one cell for each of the head.
    """
    rows = [list(row) for row in rows]
    for number, row in enumerate(rows):
        if len(row) != len(head):
            raise ValueError(f"row {number} must have {len(head)} cells, as the head {tuple(head)}; got {len(row)}")
    lines = [list(head), ["---"] * len(head), *rows]
    return Table("\n".join("| " + " | ".join(str(cell).replace("|", "\\|") for cell in line) + " |" for line in lines))
