"""Published results as executable self-tests: the installed program held against what is known of such systems."""
