"""Chaos of the map and of the noisy system: exponents, sections, spectra, and how two paths on one noise part."""
