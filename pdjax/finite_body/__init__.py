"""Finite bodies: conditions, scenes, spectra, critical loads, statics, dynamics and observers."""
