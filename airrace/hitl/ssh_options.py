"""What the options of a companion that is reached by ssh mean."""

from collections.abc import Callable
from typing import TYPE_CHECKING

from airrace.common.errors import UserError
from airrace.hitl.companion import Companion
from airrace.hitl.companion.address import Address, parse_address

if TYPE_CHECKING:
    from airrace.hitl.command import HitlOptions


def ssh_companions(options: "HitlOptions") -> Callable[[Address], Companion]:
    """Returns what makes the companion for an Address, as the options say.

    Args:
        options: HitlOptions.

    Raises:
        UserError: naming the option and the remedy.
    """
    companion = options.companion or "local"
    by_ssh = companion not in ("local", "none")
    if by_ssh:
        parse_address(companion)
    for option in ("identity", "wheels"):
        if getattr(options, option) is not None and not by_ssh:
            raise UserError(
                f"--{option} is for a companion that is reached by ssh: add -s HITL "
                "--companion USER@HOST, or leave it out."
            )
    if options.identity is not None and not options.identity.is_file():
        raise UserError(f"--identity {options.identity} is no file; name that of a private key.")
    if options.wheels is not None and not options.wheels.is_dir():
        raise UserError(
            f"--wheels {options.wheels} is no folder; fill one with pip download, as the "
            "documentation of a companion board says."
        )

    def make(address):
        from airrace.hitl.companion.ssh_companion import SshCompanion

        return SshCompanion(address, identity=options.identity, wheels=options.wheels)

    return make
