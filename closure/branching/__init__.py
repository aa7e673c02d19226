"""The closure beyond one itinerary: a Gaussian mixture whose components go on along their own impacts."""
