"""Margins of many homogeneous states of one model on one lattice: the criterion "symbol" without its waves.

`stability` judges one state and keeps it. The audit of a body has hundreds of states, which are judged once. They are
linearised by the program that `stability` compiles and searched in one batch.
"""

import numpy as np

from ..geometry.bonds import LatticeFamily
from ..models.base import AbstractModel
from .criteria.on_host import at_waves, outcomes, searched
from .criteria.outcome import margin_tolerance
from .criteria.zones import family_zone
from .lattice_states import STATES, States, check_at_rest, has_series, linearised_now, offsets_of, resting_modulus


def margins(model: AbstractModel, family: LatticeFamily, F: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The margins (states,) [-] of the deformations F (states, dim, dim), and the rounding errors of the margins.

    A margin is NaN where the law has no finite tangent. No value is traced.
    """
    check_at_rest(model, family)
    zone = family_zone(family, "inversion", None)
    starts = range(0, len(F), STATES)
    if not (has_series(model) and model.hyperelastic):
        parts = [outcomes("symbol", model, family, F[at : at + STATES], zone) for at in starts]
        margin, scale = (np.concatenate([np.asarray(getattr(p, name)) for p in parts]) for name in ("margin", "scale"))
    else:
        blocks = np.concatenate([linearised_now(model, family, F[at : at + STATES]) for at in starts])
        states = States(blocks, offsets_of(model, family), resting_modulus(model, family), float(family.spacing))
        out = at_waves(searched(states, model, family, zone), states, family)
        margin, scale = np.asarray(out.margin), np.asarray(out.scale)
    return margin, margin_tolerance(family.xi.dtype, scale)


def long_wave_margin(model: AbstractModel, family: LatticeFamily) -> float:
    """The margin [-] of long waves in the lattice at rest: −μ/M for an isotropic law with the P-wave modulus M."""
    zone = family_zone(family, "inversion", None)
    return float(np.asarray(outcomes("affine", model, family, np.eye(family.dim)[None], zone).margin)[0])
