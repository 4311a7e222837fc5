"""The firmware Betaflight in the loop: unmodified, in a process of its own, in lockstep.

What it takes to build and fly it: docs/betaflight.md.
"""
