"""Every box of the two diagrams: a LeafSystem a file, with its helpers beside it.

Folders follow the block diagram, from the plant to the controller.
"""
