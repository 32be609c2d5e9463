"""Shared parts of the figures of the paper: a sheet, a claim, and a verdict that follows from comparisons.

A sheet computes numbers and draws them. A claim reads the numbers of its sheet. It states the value of the paper, our
value, and one of four verdicts:

    confirmed                   the paper's statement agrees with the exact value
    corrected                   it does not, but a corrected statement, given in "ours", does
    refuted                     it does not, and no similar statement is true
    not decidable from the text the paper does not print what the answer depends on

The functions numbers → (ours, verdict) are in the file of the sheet whose numbers they read. A verdict always follows
from comparisons of numbers. It changes if the numbers change.
"""

from collections.abc import Callable
from typing import NamedTuple

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from matplotlib.figure import Figure

import pdjax as pd

from ...models.control import Control

Found = tuple[str, str]  # (our value in words, verdict) of one claim
VERDICTS = ("confirmed", "corrected", "refuted", "not decidable from the text")
OPEN = VERDICTS[3]
# λ and μ of three laws. The first two have the paper's S = κE under a hydrostatic load, with κ = 1.
CONSTANTS = {"bulk": (0.5, 0.0), "symmetric": (0.0, 0.5), "λ = μ = 1": (1.0, 1.0)}


class Sheet(NamedTuple):
    """A figure of the paper: what it shows, and the function quick → (numbers, Figure); `quick` reduces the sizes."""

    shows: str
    make: Callable[[bool], tuple[dict, Figure]]


class Claim(NamedTuple):
    """One statement of the paper.

    key: its name. claim: the statement in words. where: its place in the paper. paper: the value of the paper. figure:
    the sheet whose numbers decide. check: the function numbers → (ours, verdict). command: a command that shows it; the
    default is the command of the sheet. question: the question behind it, if it is a step of the derivation or a
    conclusion that was open. test: the test that checks it.
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
        """The claim as one row of the table. Its verdict follows from the numbers of its sheet."""
        ours, verdict = self.check(numbers)
        if verdict not in VERDICTS:
            raise ValueError(f"claim {self.key}: verdict must be one of {', '.join(VERDICTS)}; got {verdict!r}")
        command = self.command or f"pdjax paper --figure {self.figure}"
        words = {k: v for k, v in self._asdict().items() if k != "check"}
        return {**words, "ours": ours, "verdict": verdict, "command": command}


def judge(holds: object, corrected: object = False) -> str:
    """The verdict from two comparisons with the exact value: of the paper's statement and of a corrected one."""
    return VERDICTS[0] if holds else VERDICTS[1] if corrected else VERDICTS[2]


def close(x, y, tolerance: float = 1e-9) -> bool:
    """Whether the entries agree to a relative or absolute tolerance. Empty arrays do not agree with anything."""
    return np.size(x) * np.size(y) != 0 and bool(np.allclose(x, y, rtol=tolerance, atol=tolerance))


def sizes(quick: bool) -> str:
    """The note in the title of a figure with reduced sizes."""
    return "  (--quick: reduced sizes)" if quick else ""


def linear(lam: float, mu: float) -> pd.LinearElastic:
    """S = λ tr(E) I + 2μ E."""
    return pd.LinearElastic(lam=lam, mu=mu)  # type: ignore[call-arg, arg-type]


def of_order(m: float, law: pd.Law, control: Control | None = None) -> pd.SethHill:
    """The Seth–Hill model of order m, the model of the paper."""
    return pd.SethHill(jnp.asarray(m), law, control)


def family_within(dim: int, N: int, reach: int):
    """A family of horizon N in the arrays of a longer one, so that one compiled program serves several N."""
    return pd.lattice_family(dim, reach, influence=lambda r, _: jnp.where(r <= N * (1 + 1e-9), 1.0, 0.0))


_slope = eqx.filter_jit(pd.load_slope)


def at_once(m: float, law: pd.Law, dim: int, N: int, reach: int) -> list[bool]:
    """Whether the smallest compression, and the smallest tension, is unstable (a_cr = 0).

    This is so if the load raises the eigenvalue of a wave that has zero energy at rest.
    """
    family = family_within(dim, N, reach)
    return [float(_slope(of_order(m, law), family, side=side)) > 0 for side in ("negative", "positive")]


def signed(x: float, digits: int = 4) -> str:
    """A number with its sign."""
    return f"{x:+.{digits}f}".replace("-", "−")


def load(a: float) -> str:
    """A critical load in words: "none" if there is none between −90 % and +100 %, "0" if it is unstable at once."""
    return "none" if np.isinf(a) else "0" if a == 0 else f"{a:+.4f}".replace("-", "−")


def percent(a: float) -> str:
    """A strain in per cent, with its sign."""
    return f"{100 * a:+.3g} %".replace("-", "−")
