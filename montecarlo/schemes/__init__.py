"""The schemes that take a path through a step, how long a step may be, and what each scheme promises."""
