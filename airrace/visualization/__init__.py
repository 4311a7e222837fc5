"""The live view: what a race looks like in Drake's Meshcat."""
