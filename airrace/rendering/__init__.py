"""What the drone's camera sees: textures, the scene, and two renderers."""
