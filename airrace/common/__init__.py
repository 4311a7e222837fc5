"""What every layer may use: errors, files, resources, child processes, machine code.

The lowest layer: it imports nothing else of airrace.
"""
