"""How numba is made to compile kernels: inlined, linked, and cached by their sources. jit.py is the way in."""
