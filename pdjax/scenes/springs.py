"""The bond-based material of a plate in plane stress or strain, with the right bulk modulus inside the lattice."""

from ..geometry.bonds import LatticeFamily
from ..models.bond_based import FREE_SHEAR, BondBased
from ..models.plane import plane_bulk_modulus


def springs(young: float, poisson: float, plane: str, family: LatticeFamily) -> BondBased:
    """BondBased with the bulk modulus of Young's modulus [pressure] and Poisson's ratio, for this lattice family."""
    bulk = young / (3 * (1 - 2 * poisson))
    return BondBased.from_family(plane_bulk_modulus(bulk, FREE_SHEAR[plane] * bulk, plane), family)
