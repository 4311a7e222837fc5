"""The command line's options of a companion that is reached by ssh."""

import argparse
from collections.abc import Callable
from pathlib import Path

from airrace.common.errors import UserError
from airrace.hitl.companion import Companion
from airrace.hitl.companion.address import Address, parse_address


def add_ssh_options(group) -> None:
    """Adds --identity and --wheels to a group of a parser's that has --companion."""
    group.add_argument(
        "--identity",
        type=Path,
        metavar="FILE",
        help="HITL: the private key for --companion USER@HOST (default: those that ssh would try)",
    )
    group.add_argument(
        "--wheels",
        type=Path,
        metavar="DIR",
        help="HITL: for a companion without the internet, a folder with a wheel of "
        "every locked package, see 'On a companion computer' in the README",
    )


def ssh_companions(args: argparse.Namespace) -> Callable[[Address], Companion]:
    """Returns what makes the companion for an Address, as the options say.

    Raises:
        UserError: naming the option and the remedy.
    """
    there = args.simulation == "HITL" and args.companion not in ("local", "none")
    if there:
        parse_address(args.companion)
    for option in ("identity", "wheels"):
        if getattr(args, option) is not None and not there:
            raise UserError(
                f"--{option} is for a companion that is reached by ssh: add -s HITL "
                "--companion USER@HOST, or leave it out."
            )
    if args.identity is not None and not args.identity.is_file():
        raise UserError(f"--identity {args.identity} is no file; name that of a private key.")
    if args.wheels is not None and not args.wheels.is_dir():
        raise UserError(
            f"--wheels {args.wheels} is no folder; fill one with pip download, see "
            "'On a companion computer' in the README."
        )

    def make(address):
        from airrace.hitl.companion.ssh_companion import SshCompanion

        return SshCompanion(address, identity=args.identity, wheels=args.wheels)

    return make
