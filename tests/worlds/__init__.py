"""Simulated environments and checks that tests and benchmarks share.

Benchmarks import from here; nothing below tests/ imports from benchmarks/.
"""
