"""The result of `crack_or_instability`: a verdict for every burst of breaking bonds, and one for the run."""

from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

CRACK, INSTABILITY, UNDECIDED, NOTHING = "crack", "instability first", "undecided", "nothing broke"
SHOWN = 6  # bursts that `print` lists


def count_of(number: int, thing: str) -> str:
    """Number and thing as text, such as "1 burst" or "2 bursts"."""
    return f"{number} {thing}" + ("" if number == 1 else "s")


class Burst(NamedTuple):
    """One burst of breaking bonds and its verdict.

    Attributes
    ----------
    verdict : str
        "crack", "instability first" or "undecided".
    time : float
        Time [time] or load factor [-] at which its first bond broke.
    last : float
        Time or load factor at which its last bond broke.
    step : int
        Number of the time step or load step in which its first bond broke.
    state : int
        Number of the stored state that was judged, the last one before the burst. It is −1 if there is none.
    place : array, shape (dim,)
        Centre of the bonds that broke first [length], in the reference configuration.
    bonds : int
        Number of bonds that broke.
    margin : float
        Largest margin [-] that a quarter of the points around the first bonds reached before the burst: inf if they had
        collapsed, NaN if it was not computed.
    zero_energy : float
        Largest share [-] of zero-energy modes that a quarter of these points reached. NaN if it was not computed.
    growth : float or None
        Exponent by which a perturbation of that margin can grow from the start of the run to the judged state. None if
        no density was given.
    why : str
        The reason of the verdict.

    Examples
    --------
    >>> burst = pd.Burst("crack", 0.5, 0.5, 5, 4, np.zeros(2), 3, -0.08, 0.0, None, "the lattice was stable")
    >>> burst.verdict
    'crack'
    """

    verdict: str
    time: float
    last: float
    step: int
    state: int
    place: np.ndarray
    bonds: int
    margin: float
    zero_energy: float
    growth: float | None
    why: str


@dataclass(frozen=True, repr=False)
class FractureVerdict:
    """Result of `crack_or_instability`. `print` shows the verdict, the counts and the first bursts.

    Attributes
    ----------
    bursts : tuple of Burst
        All bursts, the first one first.
    damage : array, shape (points,)
        Share of the bonds of each point that broke in the run [-].
    burst_of : array of int, shape (points,)
        Number of the burst that broke the first bond of each point, −1 where no bond broke.
    abscissa : str
        "t" for a motion, "load factor" for a path of equilibria.
    notes : tuple of str
        What was approximated.
    soft : float
        Margin [-] above which the lattice hardly resists some wave.

    Examples
    --------
    >>> families = pd.families(pd.lattice((6, 5)), horizon=2.0)
    >>> class Run:
    ...     times, u, broken_at = np.zeros(1), np.zeros((1, 30, 2)), np.full(families.weight.shape, np.inf)
    >>> pd.crack_or_instability(pd.BondBased(1.0), families, Run())
    nothing broke
    """

    bursts: tuple[Burst, ...]
    damage: np.ndarray
    burst_of: np.ndarray
    abscissa: str
    notes: tuple[str, ...] = ()
    soft: float = 0.0

    @property
    def verdict(self) -> str:
        """Verdict of the first burst: "crack", "instability first" or "undecided". "nothing broke" without bursts."""
        return self.bursts[0].verdict if self.bursts else NOTHING

    @property
    def counts(self) -> dict[str, int]:
        """Number of bursts of each verdict."""
        verdicts = [burst.verdict for burst in self.bursts]
        return {verdict: verdicts.count(verdict) for verdict in (CRACK, INSTABILITY, UNDECIDED)}

    @property
    def bonds(self) -> dict[str, int]:
        """Number of bonds that broke in the bursts of each verdict."""
        return {
            verdict: sum(burst.bonds for burst in self.bursts if burst.verdict == verdict)
            for verdict in (CRACK, INSTABILITY, UNDECIDED)
        }

    @property
    def first_instability(self) -> int | None:
        """Number of the first burst with the verdict "instability first", or None."""
        return next((n for n, burst in enumerate(self.bursts) if burst.verdict == INSTABILITY), None)

    @property
    def summary(self) -> str:
        """The verdict, the counts, the first bursts and the notes, as text."""
        if not self.bursts:
            return "\n".join([NOTHING, *(f"note: {note}" for note in self.notes)])
        told = [f"{n} {verdict} ({count_of(self.bonds[verdict], 'bond')})" for verdict, n in self.counts.items() if n]
        lines = [f"{self.verdict}: {count_of(len(self.bursts), 'burst')}, {', '.join(told)}"]
        shown = list(range(min(SHOWN, len(self.bursts))))
        if self.first_instability is not None and self.first_instability not in shown:
            shown[-1] = self.first_instability
        for burst in (self.bursts[n] for n in shown):
            where = ", ".join(f"{x:.4g}" for x in burst.place)
            lost = count_of(burst.bonds, "bond")
            lines.append(
                f"  {self.abscissa} = {burst.time:.6g} (step {burst.step}) at ({where}), {lost}: {burst.verdict}:"
                f" {burst.why}"
            )
        if len(self.bursts) > len(shown):
            lines.append(f"  and {len(self.bursts) - len(shown)} more")
        return "\n".join([*lines, *(f"note: {note}" for note in self.notes)])

    def __repr__(self) -> str:
        return self.summary

    def as_dict(self) -> dict[str, Any]:
        """The verdict, the counts and all bursts, for JSON.

        Returns
        -------
        dict
            The verdict, the numbers of bursts and bonds of each verdict, the bursts and the notes.

        Examples
        --------
        >>> pd.FractureVerdict((), np.zeros(3), np.full(3, -1), "t").as_dict()["verdict"]
        'nothing broke'
        """
        return {
            "verdict": self.verdict,
            "counts": self.counts,
            "bonds": self.bonds,
            "abscissa": self.abscissa,
            "soft": self.soft,
            "bursts": [burst._asdict() | {"place": np.asarray(burst.place).tolist()} for burst in self.bursts],
            "notes": list(self.notes),
        }
