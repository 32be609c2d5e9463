"""What the figures of the paper share: a sheet, a claim, a verdict that follows from comparisons.

A sheet computes numbers and draws them; a claim reads the numbers of its sheet and says what the paper has, what we
have and which of four words follows:

    confirmed                   the paper's statement agrees with the exact value
    corrected                   it does not, and a corrected statement, named in "ours", does
    refuted                     it does not, and nothing of the kind is true
    not decidable from the text what it depends on is not printed

The functions numbers → (ours, verdict) stand with the sheet whose numbers they read. A verdict follows from
comparisons, never from a word typed in: it changes if the numbers do.
"""

from collections.abc import Callable
from typing import Any, NamedTuple

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from matplotlib.figure import Figure

import pdjax as pd

Found = tuple[str, str]  # (ours, verdict) of one claim
VERDICTS = ("confirmed", "corrected", "refuted", "not decidable from the text")
OPEN = VERDICTS[3]
# λ, μ of the laws that fit the paper's S = κE under hydrostatic load, κ = 1, and of the one used elsewhere
CONSTANTS = {"bulk": (0.5, 0.0), "symmetric": (0.0, 0.5), "λ = μ = 1": (1.0, 1.0)}


class Sheet(NamedTuple):
    """A figure of the paper: what it shows there, and quick → (numbers, Figure); quick at reduced sizes."""

    shows: str
    make: Callable[[bool], tuple[dict, Figure]]


class Claim(NamedTuple):
    """One statement of the paper.

    key; claim in words; where it stands; the paper's value; the sheet whose numbers decide; check: numbers → (ours,
    verdict); command that shows it, by default that of the sheet; question: its own, if it is a step of the derivation
    or a conclusion that was open; test: the test that holds it.
    """

    key: str
    claim: str
    where: str
    paper: str
    figure: str
    check: Callable[[dict], Found]
    command: str = ""
    question: str = ""
    test: str = ""

    def row(self, numbers: dict) -> dict[str, str]:
        """The claim as a line of the table, its verdict from the numbers of its sheet."""
        ours, verdict = self.check(numbers)
        if verdict not in VERDICTS:
            raise ValueError(f"claim {self.key}: verdict must be one of {', '.join(VERDICTS)}; got {verdict!r}")
        command = self.command or f"pdjax paper --figure {self.figure}"
        words = {k: v for k, v in self._asdict().items() if k != "check"}
        return {**words, "ours": ours, "verdict": verdict, "command": command}


def judge(holds: Any, corrected: Any = False) -> str:
    """The word that follows from two comparisons with the exact value: the paper's, and a corrected statement's."""
    return VERDICTS[0] if holds else VERDICTS[1] if corrected else VERDICTS[2]


def close(x, y, tolerance: float = 1e-9) -> bool:
    """Equal to a relative or absolute tolerance, entry by entry; of arrays, as many of them."""
    return np.size(x) * np.size(y) != 0 and bool(np.allclose(x, y, rtol=tolerance, atol=tolerance))


def sizes(quick: bool) -> str:
    """What a figure says of its sizes."""
    return "  (--quick: reduced sizes)" if quick else ""


def linear(lam: float, mu: float) -> Any:
    """S = λ tr(E) I + 2μ E."""
    return pd.LinearElastic(lam=lam, mu=mu)  # type: ignore[call-arg, arg-type]


def of_order(m: float, law: Any, control: Any = None) -> Any:
    """The paper's model of order m."""
    return pd.SethHill(jnp.asarray(m), law, control)


def family_within(dim: int, N: int, reach: int):
    """The family of horizon N in the arrays of a longer one, so that one compilation serves several N."""
    return pd.lattice_family(dim, reach, influence=lambda r, _: jnp.where(r <= N * (1 + 1e-9), 1.0, 0.0))


_slope = eqx.filter_jit(pd.load_slope)


def at_once(m: float, law: Any, dim: int, N: int, reach: int) -> list[bool]:
    """Whether the smallest compression, and tension, is unstable (a_cr = 0): a wave free at rest gains by it."""
    family = family_within(dim, N, reach)
    return [float(_slope(of_order(m, law), family, side=side)) > 0 for side in ("negative", "positive")]


def signed(x: float, digits: int = 4) -> str:
    """A number with its sign."""
    return f"{x:+.{digits}f}".replace("-", "−")


def load(a: float) -> str:
    """A critical load in words: 0 at once, none within −90 to +100 %."""
    return "none" if np.isinf(a) else "0" if a == 0 else f"{a:+.4f}".replace("-", "−")


def percent(a: float) -> str:
    """A strain in per cent, with its sign."""
    return f"{100 * a:+.3g} %".replace("-", "−")
