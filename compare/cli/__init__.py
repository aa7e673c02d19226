"""The command ``rattle``; its subcommands have modules of their own, or share one."""
