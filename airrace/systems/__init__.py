"""The boxes of airrace's diagrams: one LeafSystem a file."""
