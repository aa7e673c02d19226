"""Published results as executable self-tests: the installed program is compared with known properties of such systems.

Every result has negative controls: the same checks with a deliberate error, which must be rejected.
"""
