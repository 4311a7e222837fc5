"""Reinforcement learning: the race as environments of Gymnasium.

With the extra ``rl`` installed, ``gymnasium.make("airrace/Race-v0")`` makes one, without an
import of airrace. See docs/learning.md.
"""
