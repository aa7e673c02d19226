"""The branching closure: a Gaussian mixture whose components follow different itineraries."""
