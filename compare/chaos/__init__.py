"""Chaos of the noise-free orbit, of the mean maps and of the noisy system.

Lyapunov exponents, Poincaré sections, power spectra, bifurcation diagrams, and the divergence of
two paths that are driven by the same noise.
"""
