"""Ways to evaluate a body: padded families, slices of a lattice, convolutions on a lattice. One result."""
