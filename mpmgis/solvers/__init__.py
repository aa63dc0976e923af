"""The depth-averaged solver (`columns`), the 3D solver (`points`), and both on a CUDA device (`gpu`)."""
