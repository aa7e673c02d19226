"""``python -m rattle.compare``, the same as the command ``rattle``."""

from rattle.compare.cli.main import main

if __name__ == "__main__":
    main()
