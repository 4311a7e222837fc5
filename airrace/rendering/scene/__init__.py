"""What there is to see on a track: its shapes, textures, meshes and light.

Both renderers, the plant and the live view show this one scene.
"""
