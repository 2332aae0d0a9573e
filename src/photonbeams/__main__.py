"""`python -m photonbeams` is the command `photonbeams`."""

from .cli import main

main()
