"""Forces, energies, strains and stresses of bodies and of single families, and the backends of the forces."""
