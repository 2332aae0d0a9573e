"""Blender: its render engine *Photon Beams* (`extension`), and the renderer that the engine starts (`worker`).

The extension runs in Blender and imports nothing of photonbeams; the worker is a process with a Python of its own. What
the two say to each other is in `extension/messages.py`.
"""
