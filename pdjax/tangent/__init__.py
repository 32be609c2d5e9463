"""The exact tangent: ∂f/∂u of a body, and the linearised force state of one family."""
