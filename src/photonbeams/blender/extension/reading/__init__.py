"""Read a Blender scene, as its depsgraph evaluates it, into descriptions of USD prims (`usd/authoring/prims.py`)."""
