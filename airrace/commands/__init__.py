"""The `airrace` command: one file for each of its subcommands.

The top layer: app.py lists the subcommands, options.py has the options that they share.
"""
