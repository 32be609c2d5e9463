"""Tables as Markdown: text for a file, and a rendered table in a notebook."""

from collections.abc import Iterable, Sequence


class Table(str):
    """Markdown text that a notebook renders as a table, as the last value of a cell or by `display`."""

    __slots__ = ()

    def _repr_markdown_(self) -> str:
        return str(self)


def table(head: Sequence[str], rows: Iterable[Sequence]) -> Table:
    """Make a Markdown table from any values, one line for each row.

    A vertical bar within a cell is escaped.

    Parameters
    ----------
    head : sequence of str
        Names of the columns.
    rows : iterable of sequences
        The cells of each row.

    Returns
    -------
    Table
        A str that a notebook renders as a table.

    Raises
    ------
    ValueError
        If a row has not as many cells as the head.

    Examples
    --------
    >>> print(pd.figures.table(("N", "a_cr"), [(1, -0.184), (3, -0.074)]))
    | N | a_cr |
    | --- | --- |
    | 1 | -0.184 |
    | 3 | -0.074 |
    """
    rows = [list(row) for row in rows]
    for number, row in enumerate(rows):
        if len(row) != len(head):
            raise ValueError(f"row {number} must have {len(head)} cells, as the head {tuple(head)} has; got {len(row)}")
    lines = [list(head), ["---"] * len(head), *rows]
    return Table("\n".join("| " + " | ".join(str(cell).replace("|", "\\|") for cell in line) + " |" for line in lines))
