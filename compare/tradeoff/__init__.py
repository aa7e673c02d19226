"""What accuracy costs, with each scheme and each closure."""
