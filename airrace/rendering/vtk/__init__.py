"""The other renderer: Drake's RenderEngineVtk, with haze and sky of our own.

Slow without a GPU; tests hold the planar renderer against it.
"""
